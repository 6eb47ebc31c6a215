/* What the programs of this folder have in common: they are called as
 *
 *     MODEL STEPS REPETITIONS INPUTS
 *
 * INPUTS is a file with a line of numbers per step. Each prints the seconds of every repetition after one that warms
 * up, and the states after the last step in the spec's order, as bits of numbers in double precision. R is the type of
 * all numbers of a run; parameters are computed in double precision.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#ifndef R
#define R double
#endif

/* What a model defines: its inputs and states, its parameters, its state at time zero, and a step. */
enum { INPUTS_MOST = 8 };
static int inputs_count(void);
static int states_count(void);
static void parameters(void);
static void initial(void);
static void step(const R *u);
static R state(int index);

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

int main(int argc, char **argv)
{
    if (argc != 4) {
        fprintf(stderr, "usage: %s STEPS REPETITIONS INPUTS\n", argv[0]);
        return 2;
    }
    const long steps = atol(argv[1]), repetitions = atol(argv[2]);
    R *inputs = calloc((size_t)steps * INPUTS_MOST, sizeof(R));
    FILE *file = fopen(argv[3], "r");
    if (!file || !inputs)
        return 3;
    for (long k = 0; k < steps; k++)
        for (int i = 0; i < inputs_count(); i++) {
            double number;
            if (fscanf(file, "%lf", &number) != 1)
                return 3;
            inputs[k * INPUTS_MOST + i] = (R)number;
        }
    fclose(file);
    parameters();
    for (long repetition = 0; repetition <= repetitions; repetition++) {
        initial();
        const double begin = seconds();
        for (long k = 0; k < steps; k++)
            step(inputs + k * INPUTS_MOST);
        const double end = seconds();
        if (repetition > 0)
            printf("seconds %e\n", end - begin);
    }
    for (int i = 0; i < states_count(); i++) {
        const double number = (double)state(i);
        uint64_t bits;
        memcpy(&bits, &number, sizeof bits);
        printf("state %" PRIx64 "\n", bits);
    }
    free(inputs);
    return 0;
}
