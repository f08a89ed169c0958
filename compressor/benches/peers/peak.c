// Single-precision multiply-adds per second of one core: eight independent chains of each vector width the processor has.
// Prints the best of several rounds in 10^9 multiply-adds per CPU second.
#include <immintrin.h>
#include <stdio.h>
#include <time.h>

#define CHAINS 10
#define STEPS 2000000

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

static volatile float sink;

__attribute__((target("avx512f"))) static int wide(void) {
    __m512 a[CHAINS], x = _mm512_set1_ps(0.999f), y = _mm512_set1_ps(1e-3f);
    for (int c = 0; c < CHAINS; c++) a[c] = _mm512_set1_ps(c);
    for (int i = 0; i < STEPS; i++)
        for (int c = 0; c < CHAINS; c++) a[c] = _mm512_fmadd_ps(a[c], x, y);
    for (int c = 0; c < CHAINS; c++) sink += _mm512_reduce_add_ps(a[c]);
    return 16;
}

__attribute__((target("avx2,fma"))) static int narrow(void) {
    __m256 a[CHAINS], x = _mm256_set1_ps(0.999f), y = _mm256_set1_ps(1e-3f);
    for (int c = 0; c < CHAINS; c++) a[c] = _mm256_set1_ps(c);
    for (int i = 0; i < STEPS; i++)
        for (int c = 0; c < CHAINS; c++) a[c] = _mm256_fmadd_ps(a[c], x, y);
    for (int c = 0; c < CHAINS; c++) sink += _mm256_cvtss_f32(a[c]);
    return 8;
}

int main(void) {
    int (*run)(void) = __builtin_cpu_supports("avx512f") ? wide : narrow;
    double best = 0;
    for (int round = 0; round < 20; round++) {
        double start = seconds();
        double done = (double)run() * CHAINS * STEPS;
        double rate = 1e-9 * done / (seconds() - start);
        if (rate > best) best = rate;
    }
    printf("%.1f\n", best);
    return 0;
}
