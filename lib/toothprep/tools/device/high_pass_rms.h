// How strongly a sampled signal vibrates: its RMS above a corner frequency.
//
// The straight line of least squares is taken off, the rest is continued by its mirror image (so
// that the periodic continuation has no jump, which would spill into all frequencies), and by
// Parseval the RMS is the root of the sum over the spectral lines at and above the corner: an ideal
// high-pass without phase. What stays below the corner leaks through by a kink at the ends only: of
// a sine at a quarter of the corner at most 2 % of its amplitude in 1.5 s, less in longer signals.
#pragma once

#include <vector>

namespace toothprep {

// RMS in the unit of the signal. `rate` in Hz. Signals shorter than two periods of the corner, and
// rate, corner or samples that make no sense, are an Error. The Fourier transform needs lengths of
// small prime factors: from a signal longer than 1000 samples, the last few (1 % at most) may be
// left out for that.
double rms_above(const std::vector<double>& signal, double rate, double corner);

}  // namespace toothprep
