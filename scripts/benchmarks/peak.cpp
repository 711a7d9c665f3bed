// The floating-point peak of one core in GFLOP/s: independent multiply-adds that stay in registers.
#include <chrono>
#include <cstdio>

#ifdef __AVX512F__
typedef double Vector __attribute__((vector_size(64)));
#else
typedef double Vector __attribute__((vector_size(32)));
#endif
const int VECTORS = 10, LANES = sizeof(Vector) / sizeof(double);
const long TURNS = 30000000;

int main() {
    double best = 0, sum = 0;
    for (int repeat = 0; repeat < 10; repeat++) {
        Vector a[VECTORS], factor, shift;
        for (int i = 0; i < LANES; i++) factor[i] = 0.999, shift[i] = 0.001;
        for (int k = 0; k < VECTORS; k++) a[k] = shift * double(k);
        auto start = std::chrono::steady_clock::now();
        for (long turn = 0; turn < TURNS; turn++)
            for (int k = 0; k < VECTORS; k++) a[k] = a[k] * factor + shift;
        double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        double rate = 2.0 * TURNS * VECTORS * LANES / seconds / 1e9;
        if (rate > best) best = rate;
        for (int k = 0; k < VECTORS; k++) sum += a[k][0];
    }
    printf("%.3f\n", best);
    return sum == 0;
}
