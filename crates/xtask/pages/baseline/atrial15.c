/* models/atrial15: tissue of 15 x 15 x 15 cells with a cubic membrane current; classic RK4. */
#include "run.h"

enum { N = 15, CELLS = N * N * N, LAYER = N * N };
static const double STEP = 100e-6, COUPLING = 400;

/* Rate and threshold of each cell. */
static R rate[CELLS], alpha[CELLS];
static R V[CELLS], V0[CELLS], sum[CELLS], k[CELLS];

static int inputs_count(void) { return 0; }
static int states_count(void) { return CELLS; }
static R state(int i) { return V[i]; }

static void parameters(void)
{
    for (int x = 1; x <= N; x++)
        for (int y = 1; y <= N; y++)
            for (int z = 1; z <= N; z++) {
                const int i = (x - 1) * LAYER + (y - 1) * N + z - 1;
                const double q = x + N * y + N * N * z;
                rate[i] = (R)(1000 * (1 - 0.2 * (x - 1) / (N - 1)) * (1 + 0.03 * sin(1.7 * q)));
                alpha[i] = (R)(0.12 + 0.06 * (y - 1) / (N - 1) + 0.005 * cos(2.3 * q));
            }
}

static void initial(void)
{
    for (int x = 0; x < N; x++)
        for (int y = 0; y < N; y++)
            for (int z = 0; z < N; z++)
                V[x * LAYER + y * N + z] = (R)(1 / (1 + exp((sqrt(x * x + y * y + z * z) - N / 3.0) / 1.2)));
}

/* A neighbour beyond the edge is the cell itself: no flux. The two ends of a row are done apart from its inside. */
static void slopes(const R *restrict v, R *restrict d)
{
    const R D = (R)COUPLING;
    for (int x = 0; x < N; x++)
        for (int y = 0; y < N; y++) {
            const int row = x * LAYER + y * N;
            const R *own = v + row, *k_row = rate + row, *a_row = alpha + row;
            const R *left = x > 0 ? own - LAYER : own, *right = x < N - 1 ? own + LAYER : own;
            const R *down = y > 0 ? own - N : own, *up = y < N - 1 ? own + N : own;
            R *slope = d + row;
            for (int z = 0; z < N; z++)
                slope[z] = D * (left[z] + right[z] + down[z] + up[z] - 4 * own[z])
                         - k_row[z] * own[z] * (own[z] - a_row[z]) * (own[z] - 1);
            slope[0] += D * (own[1] - own[0]);
            for (int z = 1; z < N - 1; z++)
                slope[z] += D * (own[z - 1] + own[z + 1] - 2 * own[z]);
            slope[N - 1] += D * (own[N - 2] - own[N - 1]);
        }
}

/* sum += w k, V = V0 + a k */
static void advance(R a, R w)
{
    for (int i = 0; i < CELLS; i++) {
        sum[i] += w * k[i];
        V[i] = V0[i] + a * k[i];
    }
}

static void step(const R *u)
{
    const R h = (R)STEP;
    (void)u;
    memcpy(V0, V, sizeof V);
    memcpy(sum, V, sizeof V);
    slopes(V, k);
    advance(h / 2, h / 6);
    slopes(V, k);
    advance(h / 2, h / 3);
    slopes(V, k);
    advance(h, h / 3);
    slopes(V, k);
    for (int i = 0; i < CELLS; i++)
        V[i] = sum[i] + h / 6 * k[i];
}
