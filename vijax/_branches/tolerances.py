"""Tolerances and lengths by which branches decide, in one record: each with its unit and the reason for its value.

Units:

    cycle       scaled coordinates of a cycle: positions and velocities in sizes of the motion, durations in forcing
                periods, the parameter as a share of its bounds
    start       the same of positions and velocities at the start alone
    parameter   the parameter, as a share of its bounds
    periods     time, in forcing periods
    multiplier  a Floquet multiplier
    share       a ratio of two quantities of one kind

Where a comment names two values, they are in the order of the names. Counts and numbers of samples stay where they are used.
"""

# ---- Newton's method ----

# share: step, relative to the cycle, below which it counts as converged, by type: the square root of eps. More is refused.
NEWTON_CONVERGED, MOST_TOLERANCE = {"float64": 1e-8, "float32": 3e-4}, 1e-8
# eps: step below which nothing is gained; a residual of a few terms has a few of them.
NEWTON_ROUNDING = 4.0

# ---- Steps along a branch ----

# cycle: longest step unless another is requested: 5 % of the bounds. First step, and the probe before it, which measures how
# fast multipliers move.
LONGEST_STEP, FIRST_STEP, PROBE_STEP = 5e-2, 2e-3, 1e-5
# cycle: shortest step; below it differences of two points lose the digits that test functions need.
SHORTEST_STEP = 1e-9
# share: cosine of the largest angle between the tangents at the ends of a step, 11 degrees: the chord stays near the branch.
LEAST_COSINE = 0.98
# share: move of a multiplier on a step relative to its distance from +1, at most and as planned: below 1 no pair passes +1
# unseen.
MULTIPLIER_MOVE, PLANNED_MOVE = 0.6, 0.4
# cycle: step that multipliers do not shorten further; step that a double zero of a function of them does not.
NARROWEST_BY_MOVE, NARROWEST_BY_TURN = 1e-6, 1e-4
# multiplier: imaginary part below which it is real, a double one with half the digits.
REAL_MULTIPLIER = 1e-9
# cycle: longest step on which several events are accepted; a longer one is halved to separate them.
SEPARATE_EVENTS = 1e-4
# multiplier: largest one up to which a run decides whether the machine follows a cycle: beyond, rounding grows to 1e-12.
TRUSTED = 1e4

# ---- Test functions ----

# multiplier: distance below which it has its value at a bifurcation: the root of 1e-8, as a double one moves by roots.
AT_BIFURCATION = 1e-4
# multiplier: distance from the unit circle below which it is on it up to rounding; a double one has half the digits.
ON_CIRCLE = 1e-7
# multiplier: size from which one that changes sign passes infinity, not zero.
LARGE_MULTIPLIER = 1e2
# none: size of a function of multipliers, at both ends of a step, that is rounding, as without damping.
ROUNDED_FUNCTION = 1e-10
# share: speed of an impact, relative to the fastest, from which on what friction does within it is an event of the branch.
GRIP_OF_BOUNCE = 1e-2
# periods: time within which a guard vanishes at the event that cuts its flight off.
CUT_AT_ONCE = 1e-9
# periods: time from the beginning of a stick within which it touches a bound where it begins.
STICK_BEGINS = 1e-4
# periods: time from the end of a flight that is rounding.
END_OF_FLIGHT = 1e-13
# eps: slope at the first sample, relative to the largest value or derivative, that is zero.
NO_SLOPE = 8.0

# ---- Location ----

# share, cycle: length of a bracket relative to the first one, and as such, that is rounding.
BRACKET, BRACKET_ROUNDING = 4e-15, 5e-16
# share: value of a zero, and change by the slope on the way to it, relative to the value before, of a function that is zero
# around it.
FLAT_VALUE, FLAT_CHANGE = 1e-11, 1e-3
# cycle: Newton step behind which the next trial is exact to rounding, as steps shrink by squares.
QUADRATIC = 1e-9
# share: value at a zero relative to that at the ends of its bracket; a function that jumps there has a larger one.
ZERO = 1e-6
# cycle: derivative of a quantity along a branch on which it is constant, as the position of a mass at its stop.
FLAT_PEAK = 1e-8
# size of the function: value that is zero where others vanish with it by a symmetry: the equations determine its square.
SQUARE_ZERO = 1e-7
# cycle: distance of the point just before a change of the sequence.
JUST_BEFORE = 1e-7

# ---- Singular points ----

# none: largest unfolding at a point where two branches cross; its largest rate along a curve on which they keep crossing.
CROSSED, CROSSING_KEPT = 1e-9, 1e-6
# cycle: largest distance of that point from its first guess.
CROSSING_NEAR = 1e-2
# cycle: largest distance of a branch point from a fold that was located for it: the branch is level there, and the equations
# singular. Share: second derivative of the equations along the crossing branch, relative to all, that a symmetry makes zero.
PITCHFORK_NEAR, PITCHFORK_ZERO = 1e-4, 1e-6
# cycle: distance within which a branch point is one listed before. Share: difference of the times of events of two rounds along
# the crossing branch that is rounding: else the cycle that is gone round doubles its period there.
SAME_CROSSING, SAME_ROUNDS = 1e-6, 1e-3
# share: rate of a guard at its event, relative to the largest, below which another impact grazes with one.
ANOTHER_GRAZING = 1e-6
# share: imaginary part of a root, relative to the step, that is rounding.
REAL_ROOT = 1e-9
# multiplier: largest distance from -1 of one of the cycle of half the period, at the end of a doubled branch.
DOUBLING_LIKELY = 0.1
# cycle: largest distance of the two halves there, located as a fold, which is singular. Share: distance of the end beyond it.
DOUBLING_LOCATED, DOUBLING_FARTHER = 1e-6, 100.0
# share: relative difference of the parameters of a fold and of the end that is rounding. Start: for halves within this; from
# which on it alone decides.
DOUBLING_SAME, DOUBLING_APART, DOUBLING_AS_ONE = 1e-9, 1e-2, 1e-4

# ---- Behind an event ----

# cycle: lengths of the step off a point where the sequence changes; the first that is accepted counts. The machine takes an
# impact below 1e-6 for the end of a chatter. Share: largest distance from the guess.
STEP_OFF, STEPS_FROM_GUESS = (1e-6, 1e-7, 1e-5, 1e-4), 5.0
# cycle: lengths of the step past an impact in which friction stops.
TRIALS_AHEAD = 1e-6, 1e-5, 1e-4, 1e-3
# share: distance of the point behind a corner, relative to that of its plane: no branch bends nearer to a right angle.
CORNER_NEAR = 20.0
# share: size of a test function that vanishes with another one, relative to the cycle: where a symmetry makes two events one,
# both vanish as the square of what tells the cycles apart.
VANISHES_TOGETHER = 1e-7
# periods: time within which two events are at once, as exactly as an instant of a corner is located by a double root.
EVENTS_AT_ONCE = 1e-6
# start: distance behind an event that is no jump. Share of the way to which a larger one is followed back, by halves; largest
# distance there, relative to that of the plane.
NO_JUMP, JUMP_NEARER, NEARER = 1e-5, 0.1, 1.5
# periods: shortest flight of a cycle to whose chatters bounces are added: the rest of them is rounding.
LIGHTEST_FLIGHT = 1e-7
# none: size of a test function below which a given orbit lies on the event; its least rate, for it does not only touch zero.
ON_EVENT, FALLING_RATE = 1e-12, 1e-6

# ---- Corners ----

# none: largest residual, not divided by durations, of a word that the motion at a corner solves: those of others begin at 1e-2.
CORNER_SOLVED = 1e-6
# start, parameter: distance within which a corrected cycle is the corner.
SAME_CORNER = 1e-5
# share: duration between new letters, relative to the step off, of a double root.
DOUBLE_ROOT = 1e-4
# periods: negative duration that is rounding, where a symmetry keeps one at zero.
NO_FLIGHT = 1e-14
# size of the function, periods: a least value beside a letter of its own element.
ECHO_VALUE, ECHO_NEAR = 1e-5, 1e-3
# periods: times between letters of a singular word. Start: largest distance of the cycle there.
APART, APART_NEAR = (1e-4, 1e-5, 1e-3), 1e-2

# ---- Ends of branches ----

# parameter: distance from a bound within which an event lies on it.
ON_BOUND = 1e-8
# periods: duration of a stick below which it vanishes at that point: sticks vanish faster than they shorten.
VANISHING_STICK = 1e-5
# start, parameter: largest distance between a given orbit and its corrected cycle.
ORBIT_NEAR, ORBIT_AT = 1e-3, 1e-9
# multiplier: distance from 1 below which it is 1. At a fold without losses a double one keeps half the digits: it is not.
IS_ONE = 1e-10
# share: grip that an impact leaves, within which friction just stops there: the branch has a corner.
AT_CORNER = 1e-6
# start: distance within which two cycles are the same; within which a cycle has returned to its start.
SAME_CYCLE, RETURNED = 1e-8, 1e-6
# start: distance below which a cycle repeats a shorter one behind an event, where others nearly do.
SHORTER_BEHIND = 1e-11

# ---- Hops and several impacts that vanish ----

# periods: duration of a hop below which it may vanish close by. Start: largest distance of the cycle without it.
SHORT_HOP, HOP_NEAR = 5e-2, 1e-2
# periods: duration of a hop below which the time of landing is a double root. Parameter: largest move by its rounding.
DOUBLE_ROOT_HOP, HOP_MOVED = 1e-4, 1e-6
# share: speed of impacts that may vanish, relative to the fastest.
LIGHT_IMPACT = 1e-2
# cycle: length of the step that estimates the slope of a gap, and largest distance to its zero.
SLOPE_STEP, ZERO_NEAR = 1e-6, 1e-2
# speeds of the impacts that vanish: largest distance between the two cycles.
CYCLES_NEAR = 10.0
# share: largest ratio of successive parameter steps of a cascade, which approaches the coefficient of restitution.
CASCADE_RATIO = 0.95
# share: distance of the last grazing from the limit, relative to that from the fourth last, below which few grazings are
# enough: further ones are lost in rounding.
CASCADE_CERTAIN = 1e-3
# share: distances behind the limit at which a stick is searched, in distances of the last grazing from it; and the largest
# distance of the limit from its extrapolation. Start: the same of its cycle.
BEHIND_CASCADE, LIMIT_AWAY, LIMIT_NEAR = (0.1, 0.3, 1.0, 3.0, 0.03), 0.5, 1e-2

# ---- Other branches, and orbits on branches ----

# cycle: distances along another branch; the first that the machine follows counts.
TRIALS_ON_OTHER = 1e-3, 1e-4, 1e-2
# chords: largest distance from an orbit to a point at which the branch is corrected there. Share: of equal states.
MEMBER_NEAR, MEMBER_SAME = 1.0, 1e-6
# share: relative distance of equal parameters.
SAME_PARAMETER = 1e-12
# share: size of an orbit, relative to the length by which the load moves free masses, below which that is its scale.
SMALL_ORBIT = 0.1
# share: distance of a run from its start after the cycle, relative to the motion, beyond which it has left the orbit.
LEFT_ORBIT = 1e-6

# ---- Families of conservative machines ----

# share: rounding of a symmetric or positive matrix, relative to its size.
MATRIX_ROUNDING = 1e-12
# share: amplitudes beyond that of the first touch, at which a family is taken up behind it; the first that succeeds counts.
TRIALS_BEYOND_TOUCH = 1e-6, 1e-3, 1e-2, 5e-2
# share: distance of two shapes, or of two stops as a symmetric motion meets them, below which they are the same.
SAME_SHAPE = 1e-9
# multiplier: distance of a modulus from 1 at which rounding decides: of the double multiplier 1 half the digits are left.
MODE_ON_CIRCLE = 1e-6

# ---- Bifurcations as equations, and their curves ----

# share: speed of a grazing impact relative to the fastest mass. Periods: duration of a flight that is zero, by type.
NO_SPEED, NO_DURATION = 1e-9, {"float64": 1e-9, "float32": 1e-4}
# share: rounding of what must not be negative on a motion, relative to its size, and of the unfolding, by type.
VALUE_ROUNDING = {"float64": 1e-9, "float32": 1e-4}
# cycle: first, longest and shortest step along a curve.
FIRST_ON_CURVE, LONGEST_ON_CURVE, SHORTEST_ON_CURVE = 2e-3, 2e-2, 1e-9
# parameter: distance within which a point of a curve lies on a bound.
CURVE_ON_BOUND = 1e-12
# share: distance from the first point, relative to the step, within which a step of a curve passes it.
CURVE_IS_BACK = 0.1
# multiplier: modulus of an infinite one. None: independence of the neighbours that is zero. Motion: gap or force that is zero.
INFINITE_MULTIPLIER, DEPENDENT, CURVE_ZERO = 1e8, 1e-7, 1e-9
