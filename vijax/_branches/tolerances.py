"""Tolerances and lengths by which branches decide, in one record: each with its unit and the reason for its value.

Units:

    cycle       scaled coordinates of a cycle: positions and velocities in sizes of the motion, durations and times in forcing
                periods, the parameter as a share of its bounds
    start       the same of positions and velocities at the start alone
    parameter   the parameter, as a share of its bounds
    periods     time, in forcing periods
    multiplier  a Floquet multiplier
    share       a ratio of two quantities of one kind

Where a comment names two values, they are in the order of the names. Counts and numbers of samples stay where they are used.
"""

# ---- What rounding leaves, in every unit: a number that is zero is below these ----

# cycle: what a formula gives, a few hundred eps.
EXACT = 1e-12
# cycle: what is left of a solved equation: a number of a cycle, a root, a real multiplier, an orbit as given. The same by type.
ROUNDED = 1e-9
ROUNDED_BY_TYPE = {"float64": ROUNDED, "float32": 1e-4}
# cycle: distance of two solutions that are one: the root of eps, as of a step of Newton's method that has converged, see
# `_orbits/newton.py`.
SAME = 1e-8
# cycle: what is left of a double zero: of a double multiplier, or of test functions that vanish quadratically in the distance
# from a symmetric cycle.
HALF_DIGITS = 1e-7
# cycle: distance of a point that is located as a double root, of its events, and of a cycle that has returned to its start.
LOCATED = 1e-6
# share: a part of the largest of its kind that counts as none: rates, residuals of words (others begin at 1e-2), second
# derivatives that a symmetry makes zero, grips, states and test functions at their zeros.
NEGLIGIBLE = 1e-6
# cycle: distance within which a point that was searched for is the neighbour that is meant.
NEAR = 1e-2

# ---- Steps along a branch, and along a curve ----

# cycle: longest step unless another is requested: 5 % of the bounds; on a curve. First step, and the probe before it, which
# measures how fast multipliers move.
LONGEST_STEP, LONGEST_ON_CURVE, FIRST_STEP, PROBE_STEP = 5e-2, 2e-2, 2e-3, 1e-5
# cycle: shortest step; below it differences of two points lose the digits that test functions need.
SHORTEST_STEP = ROUNDED
# share: cosine of the largest angle between the tangents at the ends of a step, 11 degrees: the chord stays near the branch.
LEAST_COSINE = 0.98
# share: move of a multiplier on a step relative to its distance from +1, at most and as planned: below 1 no pair passes +1
# unseen.
MULTIPLIER_MOVE, PLANNED_MOVE = 0.6, 0.4
# cycle: step that multipliers do not shorten further.
NARROWEST_BY_MOVE = LOCATED
# cycle: longest step on which several events are accepted, or a double zero of a function of multipliers; a longer one is
# halved to separate them.
SEPARATE_EVENTS = 1e-4
# multiplier: largest one up to which a run decides whether the machine follows a cycle: beyond, rounding grows to 1e-12.
TRUSTED = 1e4
# share: distance from the first point, relative to the step, within which a step of a curve passes it.
CURVE_IS_BACK = 0.1

# ---- Test functions ----

# multiplier, cycle: distance below which a multiplier has its value at a bifurcation, and a point is the one where two meet:
# the root of 1e-8, as both move by roots.
AT_BIFURCATION = 1e-4
# multiplier: size from which one that changes sign passes infinity, not zero; modulus of an infinite one.
LARGE_MULTIPLIER, INFINITE_MULTIPLIER = 1e2, 1 / SAME
# none: size of a function of multipliers, at both ends of a step, that is rounding, as without damping.
ROUNDED_FUNCTION = 1e-10
# share: speed of impacts that may vanish, relative to the fastest; what friction does within a faster one is an event of the
# branch.
LIGHT_IMPACT = 1e-2
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
QUADRATIC = ROUNDED
# cycle: distance of the point just before a change of the sequence.
JUST_BEFORE = HALF_DIGITS

# ---- Singular points ----

# share: difference of the times of events of two rounds along the crossing branch that is rounding: else the cycle that is gone
# round doubles its period there.
SAME_ROUNDS = 1e-3
# multiplier: largest distance from -1 of one of the cycle of half the period, at the end of a doubled branch. Share: distance
# beyond that end, relative to that of the halves, at which a fold is none of it.
DOUBLING_LIKELY, DOUBLING_FARTHER = 0.1, 100.0

# cycle: largest distance of the halves of a doubled cycle whose curve may end at a degenerate period doubling; parameters, relative to
# the square of it: largest distance to that point.
HALVES_NEAR, HALVES_FARTHER = 0.05, 10.0

# ---- Behind an event ----

# cycle: lengths of the step off a point where the sequence changes; the first that is accepted counts. The machine takes an
# impact below 1e-6 for the end of a chatter. Share: largest distance from the guess.
STEP_OFF, STEPS_FROM_GUESS = (LOCATED, 1e-7, 1e-5, 1e-4), 5.0
# cycle: lengths of the step past an impact in which friction stops.
TRIALS_AHEAD = LOCATED, 1e-5, 1e-4, 1e-3
# share: distance of the point behind a corner, relative to that of its plane: no branch bends nearer to a right angle.
CORNER_NEAR = 20.0
# start: distance behind an event that is no jump. Share of the way to which a larger one is followed back, by halves; largest
# distance there, relative to that of the plane.
NO_JUMP, JUMP_NEARER, NEARER = 1e-5, 0.1, 1.5
# periods: shortest flight of a cycle to whose chatters bounces are added: the rest of them is rounding.
LIGHTEST_FLIGHT = HALF_DIGITS

# ---- Corners ----

# share: duration between new letters, relative to the step off, of a double root; periods: of a hop that lands at one.
DOUBLE_ROOT = 1e-4
# periods: negative duration that is rounding, where a symmetry keeps one at zero.
NO_FLIGHT = 1e-14
# size of the function, periods: a least value beside a letter of its own element.
ECHO_VALUE, ECHO_NEAR = 1e-5, 1e-3
# periods: times between letters of a singular word.
APART = 1e-4, 1e-5, 1e-3

# ---- Ends of branches ----

# periods: duration of a stick below which it vanishes at that point: sticks vanish faster than they shorten.
VANISHING_STICK = 1e-5
# start: largest distance between a given orbit and its corrected cycle.
ORBIT_NEAR = 1e-3
# multiplier: distance from 1 below which it is 1. At a fold without losses a double one keeps half the digits: it is not.
IS_ONE = 1e-10
# start: distance below which a cycle repeats a shorter one behind an event, where others nearly do.
SHORTER_BEHIND = 1e-11

# ---- Hops and several impacts that vanish ----

# periods: duration of a hop below which it may vanish close by.
SHORT_HOP = 5e-2
# speeds of the impacts that vanish: largest distance between the two cycles.
CYCLES_NEAR = 10.0
# share: largest ratio of successive parameter steps of a cascade, which approaches the coefficient of restitution.
CASCADE_RATIO = 0.95
# share: distance of the last grazing from the limit, relative to that from the fourth last, below which few grazings are
# enough: further ones are lost in rounding.
CASCADE_CERTAIN = 1e-3
# share: distances behind the limit at which a stick is searched, in distances of the last grazing from it; and the largest
# distance of the limit from its extrapolation.
BEHIND_CASCADE, LIMIT_AWAY = (0.1, 0.3, 1.0, 3.0, 0.03), 0.5

# ---- Other branches, and orbits on branches ----

# cycle: distances along another branch; the first that the machine follows counts.
TRIALS_ON_OTHER = 1e-3, 1e-4, 1e-2
# chords: largest distance from an orbit to a point at which the branch is corrected there.
MEMBER_NEAR = 1.0
# share: size of an orbit, relative to the length by which the load moves free masses, below which that is its scale.
SMALL_ORBIT = 0.1

# ---- Families of conservative machines ----

# share: amplitudes beyond that of the first touch, at which a family is taken up behind it; the first that succeeds counts.
TRIALS_BEYOND_TOUCH = LOCATED, 1e-3, 1e-2, 5e-2
