/* models/wave80: wave grid of 80 x 80 nodes; explicit Euler. */
#include "run.h"

enum { N = 80 };
static const double STEP = 1.0 / 44100;

/* Two grids that change roles from step to step, with an edge of zeros. */
static R grids[2][N + 2][N + 2];
static int now;

static int inputs_count(void) { return 0; }
static int states_count(void) { return N * N; }
static R state(int i) { return grids[now][i / N + 1][i % N + 1]; }
static void parameters(void) {}

static void initial(void)
{
    memset(grids, 0, sizeof grids);
    now = 0;
    for (int i = 1; i <= N; i++)
        for (int j = 1; j <= N; j++)
            grids[0][i][j] = (R)exp(-(pow(i - 0.35 * N, 2) + pow(j - 0.6 * N, 2)) / pow(N / 3.0, 2));
}

static void advance(R (*restrict v)[N + 2], R (*restrict next)[N + 2])
{
    const R a = (R)(4410 * STEP), b = (R)(1 - 17660 * STEP);
    for (int i = 1; i <= N; i++)
        for (int j = 1; j <= N; j++)
            next[i][j] = a * (v[i - 1][j] + v[i + 1][j] + v[i][j - 1] + v[i][j + 1]) + b * v[i][j];
}

static void step(const R *u)
{
    (void)u;
    advance(grids[now], grids[1 - now]);
    now = 1 - now;
}
