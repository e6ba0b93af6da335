#include "kaneflex_series.h"

#include <math.h>

#define TURN 6.283185307179586476925286766559

void kaneflex_add(const kaneflex_series *series, double factor, double t, double s[])
{
    const size_t count = series->count, *places = series->places;
    const double cycles = t / series->period, angle = TURN * (cycles - floor(cycles));
    const double *number = series->numbers;
    for (size_t i = 0; i < count; i++)
        s[places[i]] += factor * (*number++ + series->drifts[i] * cycles);
    for (size_t k = 1; k <= series->harmonics; k++, number += 2 * count) {
        const double cosine = factor * cos((double)k * angle), sine = factor * sin((double)k * angle);
        for (size_t i = 0; i < count; i++)
            s[places[i]] += number[i] * cosine + number[count + i] * sine;
    }
}

void kaneflex_repeat(const kaneflex_series *series, double t, double s[])
{
    for (size_t i = 0; i < series->count; i++)
        s[series->places[i]] = 0.0;
    kaneflex_add(series, 1.0, t, s);
}
