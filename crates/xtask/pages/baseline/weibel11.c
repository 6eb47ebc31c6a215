/* models/weibel11: airway tree of 11 generations in heap order; classic RK4. */
#include "run.h"

enum { GENERATIONS = 11, N = (1 << GENERATIONS) - 1, INNER = N / 2 };
static const double PI = 3.14159265358979323846, STEP = 100e-6;

/* Conductance of the inlet half, reciprocals of compliance, inertance and of the conductances that meet at the outlet,
 * resistance of the outlet half; index 0 is not used. */
static R g[N + 1], R2[N + 1], elastance[N + 1], per_L[N + 1], per_g[INNER + 1];

typedef struct {
    R V[N + 1], F[N + 1];
} State;

static State y, start, sum, k;
static R p[N + 1];

static int inputs_count(void) { return 2; }
static int states_count(void) { return 2 * N; }
static R state(int i) { return i < N ? y.V[i + 1] : y.F[i - N + 1]; }

static double compliance(int b)
{
    const int z = (int)floor(log2(b));
    return 0.2 / GENERATIONS / pow(2, z) * (1 + 0.04 * sin(2.1 * b));
}

static void parameters(void)
{
    const double mu = 1.9e-4, rho = 1.12e-3, per_litre = 1000 / 980.665;
    for (int b = 1; b <= N; b++) {
        const double z = floor(log2(b));
        const double d_fit = b < 16 ? 1.8 * exp(-0.388 * z) : 1.3 * exp(-(0.293 - 0.0065 * z) * z);
        const double l_fit = b < 16 ? 12 * exp(-0.92 * z) : 2.5 * exp(-0.17 * z);
        const double r = d_fit / 2 * (1 + 0.02 * sin(1.3 * b)), l = l_fit * (1 + 0.05 * cos(0.7 * b));
        const double resistance = 8 * mu * l / (PI * pow(r, 4)) * per_litre;
        R2[b] = (R)(resistance / 2);
        g[b] = (R)(1 / (resistance / 2));
        per_L[b] = (R)(1 / (rho * l / (PI * r * r) * per_litre));
        elastance[b] = (R)(1 / compliance(b));
    }
    for (int b = 1; b <= INNER; b++)
        per_g[b] = 1 / (g[2 * b] + g[2 * b + 1]);
}

static void initial(void)
{
    for (int b = 1; b <= N; b++) {
        const double z = floor(log2(b));
        y.V[b] = (R)(compliance(b) * 0.05 * (1 - z / GENERATIONS));
        y.F[b] = (R)(0.4 / pow(2, z));
    }
}

/* Pressures inside the branches, at their outlets, then the slopes. */
static void slopes(const State *restrict s, const R *restrict u, State *restrict d)
{
    static R inside[N + 1];
    for (int b = 1; b <= N; b++)
        inside[b] = s->V[b] * elastance[b];
    for (int b = 1; b <= INNER; b++)
        p[b] = (s->F[b] + g[2 * b] * inside[2 * b] + g[2 * b + 1] * inside[2 * b + 1]) * per_g[b];
    for (int b = INNER + 1; b <= N; b++)
        p[b] = u[1];
    d->V[1] = u[0] - s->F[1];
    for (int b = 1; b <= INNER; b++) {
        d->V[2 * b] = g[2 * b] * (p[b] - inside[2 * b]) - s->F[2 * b];
        d->V[2 * b + 1] = g[2 * b + 1] * (p[b] - inside[2 * b + 1]) - s->F[2 * b + 1];
    }
    for (int b = 1; b <= N; b++)
        d->F[b] = (inside[b] - p[b] - R2[b] * s->F[b]) * per_L[b];
}

/* next = from + a k, sum += w k */
static void advance(R a, R w)
{
    for (int b = 1; b <= N; b++) {
        sum.V[b] += w * k.V[b];
        y.V[b] = start.V[b] + a * k.V[b];
    }
    for (int b = 1; b <= N; b++) {
        sum.F[b] += w * k.F[b];
        y.F[b] = start.F[b] + a * k.F[b];
    }
}

static void step(const R *u)
{
    const R h = (R)STEP;
    start = y;
    sum = y;
    slopes(&y, u, &k);
    advance(h / 2, h / 6);
    slopes(&y, u, &k);
    advance(h / 2, h / 3);
    slopes(&y, u, &k);
    advance(h, h / 3);
    slopes(&y, u, &k);
    for (int b = 1; b <= N; b++) {
        y.V[b] = sum.V[b] + h / 6 * k.V[b];
        y.F[b] = sum.F[b] + h / 6 * k.F[b];
    }
}
