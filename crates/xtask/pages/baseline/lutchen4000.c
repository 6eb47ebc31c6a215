/* models/lutchen4000: convection and diffusion along an airway of 4000 cells; classic RK4. */
#include "run.h"

enum { N = 4000 };
static const double PI = 3.14159265358979323846, STEP = 100e-6, FLOW = 0.4;

/* Rates of exchange with the cell before, the own value and the cell behind; cells are 1 .. N, with a cell at each end
 * that stands for the inlet and for nothing. */
static R before[N + 2], own[N + 2], behind[N + 2];
static R y[N + 2], start[N + 2], stage[N + 2], sum[N + 2], k[N + 2];

static int inputs_count(void) { return 1; }
static int states_count(void) { return N; }
static R state(int i) { return y[i + 1]; }

static double diffusion(int i)
{
    return i > N ? 0 : 0.012 * (1 + 9 * pow((double)i / N, 2)) * (1 + 0.03 * cos(0.9 * i));
}

static void parameters(void)
{
    for (int i = 1; i <= N; i++) {
        const double v = 8e-5 * (1 + 0.5 * i / N) * (1 + 0.04 * sin(1.1 * i));
        before[i] = (R)((diffusion(i) + FLOW) / v);
        own[i] = (R)(-(diffusion(i) + diffusion(i + 1) + FLOW) / v);
        behind[i] = (R)(diffusion(i + 1) / v);
    }
}

static void initial(void)
{
    for (int i = 1; i <= N; i++)
        y[i] = (R)(0.3 + 0.2 * cos(3 * PI * i / N));
}

static void slopes(const R *restrict c, R *restrict d)
{
    for (int i = 1; i <= N; i++)
        d[i] = before[i] * c[i - 1] + own[i] * c[i] + behind[i] * c[i + 1];
}

/* sum = from + w k, stage = start + a k */
static void advance(const R *restrict from, R a, R w)
{
    for (int i = 1; i <= N; i++) {
        sum[i] = from[i] + w * k[i];
        stage[i] = start[i] + a * k[i];
    }
}

static void accumulate(R a, R w)
{
    for (int i = 1; i <= N; i++) {
        sum[i] += w * k[i];
        stage[i] = start[i] + a * k[i];
    }
}

static void step(const R *u)
{
    const R h = (R)STEP;
    y[0] = stage[0] = u[0];
    memcpy(start, y, sizeof y);
    slopes(y, k);
    advance(start, h / 2, h / 6);
    slopes(stage, k);
    accumulate(h / 2, h / 3);
    slopes(stage, k);
    accumulate(h, h / 3);
    slopes(stage, k);
    for (int i = 1; i <= N; i++)
        y[i] = sum[i] + h / 6 * k[i];
}
