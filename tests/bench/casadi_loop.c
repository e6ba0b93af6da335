/* A loop around C that CasADi generated for the function `task`, timed like those of kernels.c. */

#include "GENERATED"

void many(long n, const double *values, double **varied, const double **arg, double **res, double *w)
{
    for (long i = 0; i < n; i++) {
        for (int k = 0; k < VARIED; k++)
            *varied[k] = values[i & 15];
        task(arg, res, 0, w, 0);
    }
}
