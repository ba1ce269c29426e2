// What the stages of a fit hand to each other: start, modes, solver, estimates, diagnostics.
#pragma once

#include "toothprep/tools/calibrate/fit.h"
#include "toothprep/tools/calibrate/uncertainty.h"

namespace toothprep {

constexpr double kLeastTouched = 0.05;      // s: less of a tissue says nothing of it
constexpr double kWorstStd = 0.25;          // relative: beyond, a parameter isn't identifiable
constexpr double kLargestLog = 30;          // of u, N/mm²
constexpr std::size_t kQuietSamples = 100;  // that a noise is estimated from

// What is estimated beside the tissues' parameters.
struct Asked {
  bool bias, drift, delay, rotation, weight;
  bool lowpass = false;
};

struct FitData {
  std::vector<ComparedRecording> recordings;  // each with its sigma, behind the sensor's low-pass
  std::vector<std::vector<char>> contact;     // near it: per recording and sample
  std::vector<Chunk> chunks;
  std::size_t stride = 1;   // of the samples that a search looks at
  double force_rms = 0;     // N, measured, about its median
  bool linearised = false;  // the bases are those of a replay (coupled.h)
  double lowpass = 0;       // s, of the recordings' filters

  // What a tissue becomes that isn't fitted: absent, or held where the replay was linearised.
  TissueMode aside() const { return linearised ? TissueMode::kHeld : TissueMode::kOff; }
};

// Of a recording's basis, the sample that its sample j belongs to.
std::size_t basis_index(const ComparedRecording& recording, std::size_t j, double delay);

// The free parameters for a state's modes and what is asked for.
FreeSet free_set(const ModelState& state, std::size_t recordings, const Asked& asked);
// Of them, what enters linearly where delay, rotation and low-pass are held.
FreeSet linear_set(const ModelState& state, std::size_t recordings, const Asked& asked);

// The chunks' sums over the free parameters.
FreeSums total_of(const std::vector<NormalSums>& sums, const std::vector<Chunk>& chunks,
                  const FreeSet& free);

// A low-pass of this time constant (clamped) between bases and sensor; the state's step goes to 0.
void filter_at(double time_constant, const FitOptions& options, const Asked& asked, FitData& data,
               ModelState& state);

Mat3 rotation_matrix(const Vec3& vector);

}  // namespace toothprep
