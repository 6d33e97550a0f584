/* Positions and normals of one frame with AVX2 intrinsics, for comparison with solver/model/kernels.py.

   A vertex lies between two isolines of each of 8 fields. Between isolines k and k + 1 its transform is linear in its
   isoline coordinate: base_k + coordinate * step_k. Transforms are stored by columns of four numbers, the last of which is
   zero. So a transform is two registers, and two multiply-adds apply it to a point. The result is a register whose halves
   must be added, which is done for eight vertices together. */

#include <immintrin.h>
#include <stddef.h>

enum { FIELDS = 8, ROW = 16, MAX_ISOLINES = 64 };

typedef struct {
    __m256 xy, zw;
} Point; /* xxxxyyyy zzzzwwww */

static Point point(const float *at, __m256 w)
{
    __m256 xy = _mm256_blend_ps(_mm256_broadcast_ss(at), _mm256_broadcast_ss(at + 1), 0xf0);
    return (Point){xy, _mm256_blend_ps(_mm256_broadcast_ss(at + 2), w, 0xf0)};
}

static __m256 apply(__m256 left, __m256 right, Point p)
{
    return _mm256_fmadd_ps(right, p.zw, _mm256_mul_ps(left, p.xy));
}

/* Add the two halves of 8 registers, and gather the first three numbers of each in one register per coordinate. */
static void gather(const __m256 r[8], __m256 *x, __m256 *y, __m256 *z)
{
    __m256 s[4];
    for (int i = 0; i < 4; i++)
        s[i] = _mm256_add_ps(_mm256_permute2f128_ps(r[i], r[i + 4], 0x20), _mm256_permute2f128_ps(r[i], r[i + 4], 0x31));
    __m256 a = _mm256_unpacklo_ps(s[0], s[1]), b = _mm256_unpacklo_ps(s[2], s[3]);
    __m256 c = _mm256_unpackhi_ps(s[0], s[1]), d = _mm256_unpackhi_ps(s[2], s[3]);
    *x = _mm256_shuffle_ps(a, b, _MM_SHUFFLE(1, 0, 1, 0));
    *y = _mm256_shuffle_ps(a, b, _MM_SHUFFLE(3, 2, 3, 2));
    *z = _mm256_shuffle_ps(c, d, _MM_SHUFFLE(1, 0, 1, 0));
}

static void store_triples(float *to, __m256 x, __m256 y, __m256 z)
{
    __m256 xy = _mm256_shuffle_ps(x, y, _MM_SHUFFLE(2, 0, 2, 0));
    __m256 yz = _mm256_shuffle_ps(y, z, _MM_SHUFFLE(3, 1, 3, 1));
    __m256 zx = _mm256_shuffle_ps(z, x, _MM_SHUFFLE(3, 1, 2, 0));
    __m256 a = _mm256_shuffle_ps(xy, zx, _MM_SHUFFLE(2, 0, 2, 0));
    __m256 b = _mm256_shuffle_ps(yz, xy, _MM_SHUFFLE(3, 1, 2, 0));
    __m256 c = _mm256_shuffle_ps(zx, yz, _MM_SHUFFLE(3, 1, 3, 1));
    _mm_storeu_ps(to, _mm256_castps256_ps128(a));
    _mm_storeu_ps(to + 4, _mm256_castps256_ps128(b));
    _mm_storeu_ps(to + 8, _mm256_castps256_ps128(c));
    _mm_storeu_ps(to + 12, _mm256_extractf128_ps(a, 1));
    _mm_storeu_ps(to + 16, _mm256_extractf128_ps(b, 1));
    _mm_storeu_ps(to + 20, _mm256_extractf128_ps(c, 1));
}

static __m256 minor(__m256 a, __m256 b, __m256 c, __m256 d) /* a b - c d */
{
    return _mm256_fmsub_ps(a, b, _mm256_mul_ps(c, d));
}

/* rest and what is written: (count, 3); tangents: (count, 2, 3); slopes: (count, 8, 2); ladder: (count, 8);
   controls: (8 * isolines, 12); 8 vertices or more */
void frame(size_t count, int isolines, const float *controls, const float *weights, const float *rest,
           const float *tangents, const float *slopes, const float *ladder, float *positions, float *normals)
{
    _Alignas(32) static float lines[FIELDS * MAX_ISOLINES * 2 * ROW]; /* base_k, step_k, base_k+1, … */
    for (int field = 0; field < FIELDS; field++)
        for (int k = 0; k < isolines - 1; k++) {
            const float *low = controls + 12 * (field * isolines + k), *high = low + 12;
            float *base = lines + 2 * ROW * (field * isolines + k), *step = base + ROW;
            for (int row = 0; row < 3; row++)
                for (int column = 0; column < 4; column++) {
                    int from = 4 * row + column, to = 4 * column + row;
                    step[to] = weights[field] * (high[from] - low[from]);
                    base[to] = weights[field] * low[from] - (float)k * step[to];
                }
        }
    const __m256i first = _mm256_mullo_epi32(_mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7), _mm256_set1_epi32(isolines));
    const __m256i top = _mm256_set1_epi32(isolines - 2);
    const __m256 zero = _mm256_setzero_ps(), one = _mm256_set1_ps(1.0f);

    for (size_t block = 0; block < count; block += 8) {
        size_t start = block + 8 <= count ? block : count - 8; /* the last block overlaps the one before */
        __m256 moved[8], along_a[8], along_b[8];
        for (int j = 0; j < 8; j++) {
            size_t v = start + j;
            const float *coordinate = ladder + FIELDS * v, *slope = slopes + 2 * FIELDS * v;
            _Alignas(32) int line[FIELDS];
            __m256i below = _mm256_min_epi32(_mm256_cvttps_epi32(_mm256_loadu_ps(coordinate)), top);
            _mm256_store_si256((__m256i *)line, _mm256_slli_epi32(_mm256_add_epi32(below, first), 5));
            Point x = point(rest + 3 * v, one);
            __m256 left = zero, right = zero, more_left = zero, more_right = zero, a = zero, b = zero;
#pragma GCC unroll 8
            for (int i = 0; i < FIELDS; i++) {
                const float *base = lines + line[i];
                __m256 step_left = _mm256_load_ps(base + ROW), step_right = _mm256_load_ps(base + ROW + 8);
                __m256 at = _mm256_broadcast_ss(coordinate + i), change = apply(step_left, step_right, x);
                left = _mm256_add_ps(left, _mm256_load_ps(base));
                right = _mm256_add_ps(right, _mm256_load_ps(base + 8));
                more_left = _mm256_fmadd_ps(at, step_left, more_left);
                more_right = _mm256_fmadd_ps(at, step_right, more_right);
                a = _mm256_fmadd_ps(_mm256_broadcast_ss(slope + 2 * i), change, a);
                b = _mm256_fmadd_ps(_mm256_broadcast_ss(slope + 2 * i + 1), change, b);
            }
            left = _mm256_add_ps(left, more_left);
            right = _mm256_add_ps(right, more_right);
            moved[j] = apply(left, right, x);
            along_a[j] = _mm256_add_ps(a, apply(left, right, point(tangents + 6 * v, zero)));
            along_b[j] = _mm256_add_ps(b, apply(left, right, point(tangents + 6 * v + 3, zero)));
        }
        __m256 x, y, z, ax, ay, az, bx, by, bz;
        gather(moved, &x, &y, &z);
        store_triples(positions + 3 * start, x, y, z);
        gather(along_a, &ax, &ay, &az);
        gather(along_b, &bx, &by, &bz);
        x = minor(ay, bz, az, by);
        y = minor(az, bx, ax, bz);
        z = minor(ax, by, ay, bx);
        __m256 square = _mm256_fmadd_ps(x, x, _mm256_fmadd_ps(y, y, _mm256_mul_ps(z, z)));
        __m256 scale = _mm256_div_ps(one, _mm256_sqrt_ps(square));
        scale = _mm256_and_ps(scale, _mm256_cmp_ps(square, zero, _CMP_GT_OQ));
        store_triples(normals + 3 * start, _mm256_mul_ps(x, scale), _mm256_mul_ps(y, scale), _mm256_mul_ps(z, scale));
    }
}
