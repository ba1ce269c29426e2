#include "toothprep/tools/device/high_pass_rms.h"

#include <cmath>
#include <complex>
#include <unsupported/Eigen/FFT>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

std::size_t largest_prime_factor(std::size_t n) {
  std::size_t largest = 1;
  for (std::size_t p = 2; p * p <= n; ++p)
    for (; n % p == 0; n /= p) largest = p;
  return n > 1 ? n : largest;
}

// The cost of the transform goes with the length times its largest prime factor.
std::size_t good_length(std::size_t n) {
  while (n > 1000 && largest_prime_factor(n) > 31) --n;
  return n;
}

}  // namespace

double rms_above(const std::vector<double>& signal, double rate, double corner) {
  if (!(std::isfinite(rate) && rate > 0)) throw Error("RMS above a corner: the rate must be > 0");
  if (!(corner > 0 && corner < rate / 2))
    throw Error("RMS above a corner: the corner must lie between 0 and half the sample rate");
  if (static_cast<double>(signal.size()) * corner < 2 * rate)
    throw Error("RMS above a corner: the signal is shorter than two periods of the corner");
  for (const double x : signal)
    if (!std::isfinite(x))
      throw Error("RMS above a corner: the signal holds values that aren't finite");

  const std::size_t n = good_length(signal.size());
  const double middle = 0.5 * static_cast<double>(n - 1);
  double mean = 0, slope = 0, spread = 0;
  for (std::size_t i = 0; i < n; ++i) mean += signal[i] / static_cast<double>(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double t = static_cast<double>(i) - middle;
    slope += t * (signal[i] - mean);
    spread += t * t;
  }
  slope /= spread;

  std::vector<double> mirrored(2 * n);
  for (std::size_t i = 0; i < n; ++i)
    mirrored[i] = mirrored[2 * n - 1 - i] =
        signal[i] - mean - slope * (static_cast<double>(i) - middle);
  Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  std::vector<std::complex<double>> lines;  // 0 ... n; all but the ends stand for two
  fft.fwd(lines, mirrored);
  double sum = 0;
  for (std::size_t k = 1; k <= n; ++k) {
    const double frequency = rate * static_cast<double>(k) / static_cast<double>(2 * n);
    if (frequency >= corner) sum += (k == n ? 1 : 2) * std::norm(lines[k]);
  }
  return std::sqrt(sum) / static_cast<double>(2 * n);
}

}  // namespace toothprep
