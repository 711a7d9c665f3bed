// One mass on a spring and a damper, with dry friction and a harmonic load, and nothing else, one trajectory after
// another: exact flights in closed form, proved steps to the next zero of the velocity, turns, sticks, static friction.
//     m x'' + c x' + k x = A cos(W t) - F sgn(x')
//
//     friction_reference sweep m c k A F Fs W0 W1 points transient record
//     friction_reference trajectory m c k A F Fs W t1 x0 v0 repeats
//
// `sweep` starts every frequency from rest and prints the turns, sticks and slips of the recorded periods, all counted
// together, and the sums of |x| and |v| at the ends. `ends` in its place prints for each frequency its three counts and its
// last x and v. `trajectory` prints "turn|stick|slip time x" for every event, "end x v" and, for each repeat, "seconds s".
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>
using std::max;
using std::min;

const double TINY = 1e-300;
const char* const NAMES[3] = {"turn", "stick", "slip"};
enum Kind { TURN, STICK, SLIP };

struct Event {
    Kind kind;
    double time, x;
};

struct Log {
    bool is_on, is_full;
    double start;
    long count[3];
    std::vector<Event> events;
    void add(Kind kind, double t, double x) {
        if (!is_on) return;
        count[kind]++;
        if (is_full) events.push_back({kind, start + t, x});
    }
};

// The machine divided by its mass, its mode, and its steady response x = re cos(th) - im sin(th).
struct Machine {
    double drag, w2, load, force, grip, W;
    double decay, damped, re, im, period, longest, near, steady_fifth;
    Machine(double m, double c, double k, double A, double F, double Fs, double W)
        : drag(c / m), w2(k / m), load(A / m), force(F / m), grip(Fs / m), W(W) {
        decay = drag / 2;
        damped = sqrt(w2 - decay * decay);
        double stiff = w2 - W * W, slow = drag * W, square = stiff * stiff + slow * slow;
        re = load * stiff / square;
        im = -load * slow / square;
        period = 2 * M_PI / W;
        double rate = max(sqrt(w2), W);
        longest = 1.5 / rate;
        near = 1e-3 / rate;
        steady_fifth = W * W * W * W * W * load / sqrt(square);
    }
};

// What the Taylor polynomial of the velocity begins with after an event: a jump of the acceleration, or a jerk.
enum Begins { MOVING, BY_ACCELERATION, BY_JERK };

struct State {
    double x, v;
    int direction;  // 0: sticks
    Begins begins;
};

// Velocity, and its derivatives, in the direction of slip.
struct Guard {
    double h, h1, h2, h3;
};

static inline Guard guard(const Machine& p, const State& s, double cosine, double sine) {
    double a = p.load * cosine - p.drag * s.v - p.w2 * s.x - s.direction * p.force;
    double jerk = -p.load * p.W * sine - p.drag * a - p.w2 * s.v;
    double snap = -p.load * p.W * p.W * cosine - p.drag * jerk - p.w2 * a;
    double d = s.direction;
    return {d * s.v, d * a, d * jerk, d * snap};
}

// A time in which h + h1 t + h2 t^2 / 2 + h3 t^3 / 6 - bound t^4 / 24 stays positive.
static inline double safe_step(Begins begins, const Guard& g, double bound, double longest) {
    double h = max(g.h, 0.0), best = 0, trial = longest;
    if (begins == BY_JERK) {
        for (int turn = 0; turn < 3; turn++) {
            double u = max(g.h2, 0.0) / max(TINY, -g.h3 / 3 + bound * trial / 12);
            best = max(best, min(u, trial));
            if (u >= trial) break;
            trial = (u + trial) / 2;
        }
        return max(best, 1e-5);
    }
    if (begins == BY_ACCELERATION) h = 0;
    double low = 0, high = longest;
    for (int turn = 0; turn < 3; turn++) {
        double curvature = -g.h2 + max(0.0, -g.h3) * trial / 3 + bound * trial * trial / 12;
        double square = g.h1 * g.h1 + 2 * curvature * h;
        double u = trial;
        if (square >= 0 && (g.h1 < 0 || curvature > 0)) {
            double root = sqrt(square);
            u = g.h1 < 0 ? 2 * h / (root - g.h1 + TINY) : (g.h1 + root) / (curvature + TINY);
        }
        best = max(best, min(u, trial));
        if (u >= trial) {
            if (turn == 0) return trial;
            low = trial;
        } else {
            high = trial;
        }
        trial = turn == 0 ? min(u * 1.5, high) : 0.5 * (max(best, low) + high);
    }
    return best;
}

// Time to a zero of the guard so near that its Taylor polynomial has it to rounding; negative if there is none.
static inline double near_zero(const Machine& p, const Guard& g) {
    if (!(g.h1 < 0) || g.h > -g.h1 * p.near) return -1;
    double u = -g.h / g.h1;
    for (int turn = 0; turn < 3; turn++)
        u -= (g.h + u * (g.h1 + u * (g.h2 / 2 + u * g.h3 / 6))) / (g.h1 + u * (g.h2 + u * g.h3 / 2));
    return u >= 0 && u < p.near ? u : -1;
}

// The mass has come to rest, or the load exceeds the grip: it sticks, or slips.
static inline void decide(const Machine& p, State& s, double cosine, double t, int released, Log& log) {
    int before = s.direction;
    double pull = p.load * cosine - p.w2 * s.x;
    int now = released ? released : pull > p.grip ? 1 : pull < -p.grip ? -1 : 0;
    s.v = 0;
    s.direction = now;
    s.begins = p.grip > p.force || !released ? BY_ACCELERATION : BY_JERK;
    log.add(released ? SLIP : now == 0 ? STICK : TURN, t, s.x);
    if (now == before && now != 0) s.begins = BY_JERK;  // a velocity that touches zero
}

// Phase at which the load on the sticking mass next leaves its grip, beyond all if never, and to which side.
static inline double release(const Machine& p, const State& s, double phase, int& side) {
    double next = 1e300;
    side = 0;
    double above = (p.w2 * s.x + p.grip) / p.load, below = (p.w2 * s.x - p.grip) / p.load;
    if (fabs(above) < 1) {  // the load rises, at -acos
        double at = 2 * M_PI - acos(above);
        if (at < phase - 1e-12) at += 2 * M_PI;
        if (at < next) next = at, side = 1;
    }
    if (fabs(below) < 1) {
        double at = acos(below);
        if (at < phase - 1e-12) at += 2 * M_PI;
        if (at < next) next = at, side = -1;
    }
    return next;
}

// Follow the motion for a time from phase 0.
static void advance(const Machine& p, State& s, double duration, Log& log) {
    double t = 0, phase = 0, cosine = 1, sine = 0;
    for (long steps = 0; t < duration; steps++) {
        if (steps > 300000) {
            fprintf(stderr, "no end at W = %g\n", p.W);
            exit(1);
        }
        if (s.direction == 0) {
            int side;
            double next = release(p, s, phase, side), at = next / p.W;
            if (at >= duration) return;
            phase = max(next, phase);
            t = max(at, t);
            cosine = cos(phase);
            sine = sin(phase);
            decide(p, s, cosine, t, side, log);
            continue;
        }
        Guard g = guard(p, s, cosine, sine);
        if (s.begins == MOVING) {
            double u = near_zero(p, g);
            if (u >= 0 && t + u < duration) {
                double d = s.direction;
                s.x += d * u * (g.h + u * (g.h1 / 2 + u * (g.h2 / 6 + u * g.h3 / 24)));
                t += u;
                phase = p.W * t;
                cosine = cos(phase);
                sine = sin(phase);
                decide(p, s, cosine, t, 0, log);
                continue;
            }
        }
        // x = offset + steady response + e^(-decay t) (B cos + C sin)
        double offset = -s.direction * p.force / p.w2;
        double B = s.x - offset - (p.re * cosine - p.im * sine);
        double rate = s.v + p.W * (p.re * sine + p.im * cosine);
        double C = (rate + p.decay * B) / p.damped;
        double bound = p.w2 * p.w2 * sqrt(p.w2 * (B * B + C * C)) + p.steady_fifth;
        double step = min(safe_step(s.begins, g, bound, p.longest), duration - t);
        t = step >= duration - t ? duration : t + step;
        phase = p.W * t;
        cosine = cos(phase);
        sine = sin(phase);
        double fade = exp(-p.decay * step);
        double c = fade * cos(p.damped * step), d = fade * sin(p.damped * step);
        double q = B * c + C * d;
        s.x = offset + p.re * cosine - p.im * sine + q;
        s.v = -p.W * (p.re * sine + p.im * cosine) - p.decay * q + p.damped * (C * c - B * d);
        if (step > 0) s.begins = MOVING;
    }
}

struct Run {
    Machine machine;
    State state;
    Log log;
    Run(char** a, double W, double x = 0, double v = 0)
        : machine(atof(a[0]), atof(a[1]), atof(a[2]), atof(a[3]), atof(a[4]), atof(a[5]), W), state{}, log{} {
        double pull = machine.load - machine.w2 * x;
        int torn = pull > machine.grip ? 1 : pull < -machine.grip ? -1 : 0;
        state = {x, v, v > 0 ? 1 : v < 0 ? -1 : torn, v == 0 ? BY_ACCELERATION : MOVING};
    }
    void one_period(double longest) { advance(machine, state, min(machine.period, longest), log); }
};

static void sweep(char** a, bool ends) {
    double W0 = atof(a[6]), W1 = atof(a[7]), x = 0, v = 0;
    int points = atoi(a[8]), transient = atoi(a[9]), record = atoi(a[10]);
    long count[3] = {0, 0, 0};
    for (int k = 0; k < points; k++) {
        Run run(a, points > 1 ? W0 + (W1 - W0) * k / (points - 1) : W0);
        for (int q = 0; q < transient + record; q++) {
            run.log.is_on = q >= transient;
            run.one_period(run.machine.period);
        }
        const long* own = run.log.count;
        for (int j = 0; j < 3; j++) count[j] += own[j];
        x += fabs(run.state.x);
        v += fabs(run.state.v);
        if (ends) printf("%ld %ld %ld %.17g %.17g\n", own[0], own[1], own[2], run.state.x, run.state.v);
    }
    if (!ends) printf("%ld %ld %ld %.17g %.17g\n", count[0], count[1], count[2], x, v);
}

static void trajectory(char** a) {
    double t1 = atof(a[7]);
    for (int repeat = 0; repeat < atoi(a[10]); repeat++) {
        auto start = std::chrono::steady_clock::now();
        Run run(a, atof(a[6]), atof(a[8]), atof(a[9]));
        run.log.is_on = run.log.is_full = true;
        for (int q = 0; q * run.machine.period < t1; q++) {
            run.log.start = q * run.machine.period;
            run.one_period(t1 - run.log.start);
        }
        double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        if (repeat == 0) {
            for (const Event& e : run.log.events) printf("%s %.17g %.17g\n", NAMES[e.kind], e.time, e.x);
            printf("end %.17g %.17g\n", run.state.x, run.state.v);
        }
        printf("seconds %.9f\n", seconds);
    }
}

int main(int argc, char** argv) {
    std::string what = argc > 1 ? argv[1] : "";
    if ((what == "sweep" || what == "ends") && argc == 13) return sweep(argv + 2, what == "ends"), 0;
    if (what == "trajectory" && argc == 13) return trajectory(argv + 2), 0;
    fprintf(stderr, "See the head of friction_reference.cpp for the arguments.\n");
    return 2;
}
