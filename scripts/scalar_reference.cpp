// The paper's two-mass chain and nothing else, one trajectory after another: exact modal flow, proved steps,
// impacts, sticking. What vijax is measured against.
//
//     scalar_reference sweep s1 s2 A W0 W1 points transient record
//     scalar_reference trajectory s1 s2 A W t1 repeats
//
// `sweep` starts every frequency from rest and prints the impacts of the recorded periods, all counted
// together. `trajectory` prints "impact stop time velocity" for every impact, "end x1 x2 v1 v2" and, for each
// repeat, "seconds s". Stop i belongs to mass i; it is an upper stop if s >= 0, else a lower one.
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

const double DAMPING = 0.1, STIFFNESS = 1, RESTITUTION = 0.7;
const double LONGEST_STEP = 1.5, TOUCHING = 1e-14, TINY = 1e-300;
// A chatter whose impacts are lighter than LIGHT and which ends within SOON is ended at once.
const double LIGHT = 1e-6, SOON = 1e-3, STILL = 1e-13;

struct Impact {
    int stop;
    double time, velocity;
};

struct Log {
    bool is_on;
    double start;
    std::vector<Impact> impacts;
};

struct Machine {
    double stop[2], sign[2], amplitude, frequency;
};

// The motion with some masses held: modes, and the forced motion x = re cos(th) - im sin(th) around `rest`.
struct Modes {
    int count;
    double frequency[2], decay[2], damped[2], shape[2][2], rest[2], re[2], im[2];
};

// How a mass got where it is; it decides what the polynomial of its gap starts with.
enum Contact { OPEN, JUST_HIT, LET_GO_BY_JUMP, LET_GO_BY_FORCE };

struct State {
    double x[2], v[2], phase;
    int held;  // bit i: mass i
    int contact[2];
    bool is_held(int i) const { return held >> i & 1; }
};

static Modes modes(const Machine& p, int held) {
    Modes m;
    memset(&m, 0, sizeof m);
    if (held == 0) {
        m.count = 2;
        const double root = sqrt(5.0), value[2] = {(3 - root) / 2, (3 + root) / 2};
        for (int j = 0; j < 2; j++) {
            double b = 2 - value[j], length = hypot(1, b);
            m.shape[0][j] = 1 / length;
            m.shape[1][j] = b / length;
            m.frequency[j] = sqrt(value[j] * STIFFNESS);
            m.decay[j] = DAMPING * value[j] / 2;
        }
    } else if (held < 3) {
        int fixed = held - 1, free = 1 - fixed;
        double value = free == 0 ? 2 : 1;
        m.count = 1;
        m.shape[free][0] = 1;
        m.frequency[0] = sqrt(value * STIFFNESS);
        m.decay[0] = DAMPING * value / 2;
        m.rest[fixed] = p.stop[fixed];
        m.rest[free] = p.stop[fixed] / value;
    } else {
        for (int i = 0; i < 2; i++) m.rest[i] = p.stop[i];
    }
    for (int j = 0; j < m.count; j++) {
        m.damped[j] = sqrt(m.frequency[j] * m.frequency[j] - m.decay[j] * m.decay[j]);
        double load = m.shape[0][j] * p.amplitude;
        double re = m.frequency[j] * m.frequency[j] - p.frequency * p.frequency;
        double im = 2 * m.decay[j] * p.frequency, square = re * re + im * im;
        for (int i = 0; i < 2; i++) {
            m.re[i] += m.shape[i][j] * load * re / square;
            m.im[i] -= m.shape[i][j] * load * im / square;
        }
    }
    return m;
}

// Acceleration of free masses, or with (v, a, -W sin th) in place of (x, v, cos th) its rate.
static inline void accelerations(const Machine& p, const double* x, const double* v, double load, double* f) {
    f[0] = -STIFFNESS * (2 * x[0] - x[1]) - DAMPING * (2 * v[0] - v[1]) + p.amplitude * load;
    f[1] = -STIFFNESS * (x[1] - x[0]) - DAMPING * (v[1] - v[0]);
}

struct Forces {
    double force[2], rate[2], acceleration[2], jerk[2];
};

static inline Forces forces(const Machine& p, const State& s, double cosine, double sine) {
    Forces f;
    accelerations(p, s.x, s.v, cosine, f.force);
    for (int i = 0; i < 2; i++) f.acceleration[i] = s.is_held(i) ? 0 : f.force[i];
    accelerations(p, s.v, f.acceleration, -p.frequency * sine, f.rate);
    for (int i = 0; i < 2; i++) f.jerk[i] = s.is_held(i) ? 0 : f.rate[i];
    return f;
}

// A time in which g + g1 t + g2 t^2 / 2 + g3 t^3 / 6 - bound t^4 / 24 stays positive.
static inline double safe_step(int contact, double g, double g1, double g2, double g3, double bound) {
    double best = 0, trial = LONGEST_STEP;
    if (contact == LET_GO_BY_FORCE) return min(max(4 * max(g3, 0.0) / (bound + TINY), 1e-5), LONGEST_STEP);
    if (contact == LET_GO_BY_JUMP) {
        for (int turn = 0; turn < 3; turn++) {
            double u = max(g2, 0.0) / max(TINY, -g3 / 3 + bound * trial / 12);
            best = max(best, min(u, trial));
            if (u >= trial) break;
            trial = (u + trial) / 2;
        }
        return max(best, 1e-5);
    }
    if (contact == JUST_HIT) g = 0;
    double low = 0, high = LONGEST_STEP;
    for (int turn = 0; turn < 5; turn++) {
        double curvature = max(0.0, -g2 + max(0.0, -g3) * trial / 3 + bound * trial * trial / 12);
        double root = sqrt(g1 * g1 + 2 * curvature * g);
        double u = g1 < 0 ? 2 * g / (root - g1 + TINY) : (g1 + root) / (curvature + TINY);
        best = max(best, min(u, trial));
        if (u >= trial) {
            if (turn == 0) return trial;
            low = trial;
        } else {
            high = trial;
        }
        trial = u > low && u < high && turn == 0 ? min(u * 1.5, high) : 0.5 * (max(best, low) + high);
    }
    return best;
}

// A time in which the force that presses a held mass stays positive.
static inline double safe_hold(double force, double rate, double bound) {
    double root = sqrt(rate * rate + 2 * bound * force);
    return (rate < 0 ? 2 * force / (root - rate + TINY) : (rate + root) / (bound + TINY)) + 1e-13;
}

// q = e^(-decay t) (B cos + C sin) of each mode.
struct Amplitudes {
    double B[2], C[2];
};

static inline Amplitudes amplitudes(const Machine& p, const Modes& m, const State& s, double cosine,
                                    double sine) {
    Amplitudes a;
    double y[2], w[2];
    for (int i = 0; i < 2; i++) {
        y[i] = s.x[i] - m.rest[i] - (m.re[i] * cosine - m.im[i] * sine);
        w[i] = s.v[i] + p.frequency * (m.re[i] * sine + m.im[i] * cosine);
    }
    for (int j = 0; j < m.count; j++) {
        a.B[j] = m.shape[0][j] * y[0] + m.shape[1][j] * y[1];
        double rate = m.shape[0][j] * w[0] + m.shape[1][j] * w[1];
        a.C[j] = (rate + m.decay[j] * a.B[j]) / m.damped[j];
    }
    return a;
}

static inline double step_length(const Machine& p, const Modes& m, const State& s, const Amplitudes& a,
                                 const Forces& f, double longest) {
    double second[2], third[2], fourth[2];  // bounds of the derivatives of x
    for (int i = 0; i < 2; i++) {
        second[i] = p.frequency * p.frequency * hypot(m.re[i], m.im[i]);
        third[i] = p.frequency * second[i];
        fourth[i] = p.frequency * third[i];
        for (int j = 0; j < m.count; j++) {
            double size = sqrt(a.B[j] * a.B[j] + a.C[j] * a.C[j]);
            double q = fabs(m.shape[i][j]) * m.frequency[j] * m.frequency[j] * size;
            second[i] += q;
            third[i] += q * m.frequency[j];
            fourth[i] += q * m.frequency[j] * m.frequency[j];
        }
    }
    double step = min(longest, LONGEST_STEP);
    for (int i = 0; i < 2; i++) {
        double sign = p.sign[i];
        if (s.is_held(i)) {
            double bound = STIFFNESS * second[1 - i] + DAMPING * third[1 - i];
            if (i == 0) bound += p.amplitude * p.frequency * p.frequency;
            step = min(step, safe_hold(max(0.0, sign * f.force[i]), sign * f.rate[i], bound));
        } else {
            double gap = max(0.0, sign * (p.stop[i] - s.x[i]));
            step = min(step, safe_step(s.contact[i], gap, -sign * s.v[i], -sign * f.acceleration[i],
                                       -sign * f.jerk[i], fourth[i]));
        }
    }
    return step;
}

static inline void move(const Machine& p, const Modes& m, State& s, const Amplitudes& a, double step,
                        double cosine, double sine) {
    double x[2], v[2];
    for (int i = 0; i < 2; i++) {
        x[i] = m.rest[i] + m.re[i] * cosine - m.im[i] * sine;
        v[i] = -p.frequency * (m.re[i] * sine + m.im[i] * cosine);
    }
    for (int j = 0; j < m.count; j++) {
        double decay = exp(-m.decay[j] * step);
        double c = decay * cos(m.damped[j] * step), d = decay * sin(m.damped[j] * step);
        double q = a.B[j] * c + a.C[j] * d;
        double rate = -m.decay[j] * q + m.damped[j] * (a.C[j] * c - a.B[j] * d);
        for (int i = 0; i < 2; i++) {
            x[i] += m.shape[i][j] * q;
            v[i] += m.shape[i][j] * rate;
        }
    }
    for (int i = 0; i < 2; i++) {
        s.x[i] = s.is_held(i) ? p.stop[i] : x[i];
        s.v[i] = s.is_held(i) ? 0 : v[i];
        if (step > 0) s.contact[i] = OPEN;
    }
}

// Impacts, and after them the masses that stick and those that are let go.
static inline void contacts(const Machine& p, State& s, double cosine, double sine, double t, Log& log) {
    bool hit[2] = {false, false};
    for (int i = 0; i < 2; i++) {
        if (s.is_held(i) || p.sign[i] * (p.stop[i] - s.x[i]) > TOUCHING || p.sign[i] * s.v[i] <= 0) continue;
        if (log.is_on) log.impacts.push_back({i, log.start + t, s.v[i]});
        s.x[i] = p.stop[i];
        s.v[i] *= -RESTITUTION;
        s.contact[i] = JUST_HIT;
        hit[i] = true;
    }
    const Forces f = forces(p, s, cosine, sine);
    for (int i = 0; i < 2; i++) {
        double force = p.sign[i] * f.force[i], rate = p.sign[i] * f.rate[i], speed = fabs(s.v[i]);
        if (hit[i] && force > 0 && speed < LIGHT) {
            double end = 2 * speed / (force * (1 - RESTITUTION) + TINY);
            if (speed < STILL || (end < SOON && force + 2 * min(rate, 0.0) * end > 0)) {
                s.v[i] = 0;
                s.held |= 1 << i;
                s.contact[i] = OPEN;
            }
        } else if (hit[i] && force <= 0 && speed < STILL) {
            s.v[i] = 0;
            s.contact[i] = force < 0 ? LET_GO_BY_JUMP : LET_GO_BY_FORCE;
        } else if (!hit[i] && s.is_held(i) && force <= 0) {
            s.held &= ~(1 << i);
            s.contact[i] = (hit[0] || hit[1]) && force < -1e-9 ? LET_GO_BY_JUMP : LET_GO_BY_FORCE;
        }
    }
}

// Follow the motion for a time from phase 0.
static void advance(const Machine& p, const Modes* all, State& s, double duration, Log& log) {
    double t = 0, cosine = 1, sine = 0;
    s.phase = 0;
    for (long steps = 0; t < duration; steps++) {
        if (steps > 300000) {
            fprintf(stderr, "no end at W = %g\n", p.frequency);
            exit(1);
        }
        const Modes& m = all[s.held];
        const Amplitudes a = amplitudes(p, m, s, cosine, sine);
        double step = step_length(p, m, s, a, forces(p, s, cosine, sine), duration - t);
        s.phase += p.frequency * step;
        t += step;
        cosine = cos(s.phase);
        sine = sin(s.phase);
        move(p, m, s, a, step, cosine, sine);
        contacts(p, s, cosine, sine, t, log);
    }
}

struct Run {
    Machine machine;
    Modes all[4];
    State state;
    Log log;
    Run(double s1, double s2, double amplitude, double frequency)
        : machine{{s1, s2}, {s1 >= 0 ? 1.0 : -1.0, s2 >= 0 ? 1.0 : -1.0}, amplitude, frequency}, log{} {
        for (int held = 0; held < 4; held++) all[held] = modes(machine, held);
        memset(&state, 0, sizeof state);
    }
    double period() const { return 2 * M_PI / machine.frequency; }
    void one_period(double longest) { advance(machine, all, state, min(period(), longest), log); }
};

static void sweep(char** a) {
    double W0 = atof(a[3]), W1 = atof(a[4]);
    int points = atoi(a[5]), transient = atoi(a[6]), record = atoi(a[7]);
    size_t impacts = 0;
    for (int k = 0; k < points; k++) {
        Run run(atof(a[0]), atof(a[1]), atof(a[2]), points > 1 ? W0 + (W1 - W0) * k / (points - 1) : W0);
        for (int q = 0; q < transient + record; q++) {
            run.log.is_on = q >= transient;
            run.log.start = (q - transient) * run.period();
            run.one_period(run.period());
        }
        impacts += run.log.impacts.size();
    }
    printf("%zu\n", impacts);
}

static void trajectory(char** a) {
    double t1 = atof(a[4]);
    for (int repeat = 0; repeat < atoi(a[5]); repeat++) {
        auto start = std::chrono::steady_clock::now();
        Run run(atof(a[0]), atof(a[1]), atof(a[2]), atof(a[3]));
        run.log.is_on = true;
        for (int q = 0; q * run.period() < t1; q++) {
            run.log.start = q * run.period();
            run.one_period(t1 - run.log.start);
        }
        double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        const State& s = run.state;
        if (repeat == 0) {
            for (const Impact& i : run.log.impacts)
                printf("impact %d %.17g %.17g\n", i.stop, i.time, i.velocity);
            printf("end %.17g %.17g %.17g %.17g\n", s.x[0], s.x[1], s.v[0], s.v[1]);
        }
        printf("seconds %.9f\n", seconds);
    }
}

int main(int argc, char** argv) {
    std::string what = argc > 1 ? argv[1] : "";
    if (what == "sweep" && argc == 10) return sweep(argv + 2), 0;
    if (what == "trajectory" && argc == 8) return trajectory(argv + 2), 0;
    fprintf(stderr, "See the head of scalar_reference.cpp for the arguments.\n");
    return 2;
}
