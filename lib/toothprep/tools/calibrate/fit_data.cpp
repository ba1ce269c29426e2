#include "toothprep/tools/calibrate/fit_data.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace toothprep {

std::size_t basis_index(const ComparedRecording& r, std::size_t j, double delay) {
  const double place = (r.time[j] - delay - r.basis->start) / r.basis->step + 0.5;
  return static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(r.basis->size - 1)));
}

FreeSet free_set(const ModelState& state, std::size_t recordings, const Asked& asked) {
  FreeSet free(recordings);
  for (int k = 0; k < kTissueCount; ++k) {
    if (state.mode[k] == TissueMode::kFree) free.free_shared(2 * k);
    if (state.mode[k] == TissueMode::kFree || state.mode[k] == TissueMode::kTied)
      free.free_shared(2 * k + 1);
  }
  if (asked.delay) free.free_shared(kDelay);
  if (asked.lowpass) free.free_shared(kLowpass);
  for (int i = 0; i < 3; ++i) {
    if (asked.rotation) free.free_shared(kRotation + i);
    if (asked.weight) free.free_shared(kWeight + i);
  }
  for (int s = 0; s < state.shapes; ++s) free.free_shared(kShape + s);
  for (std::size_t r = 0; r < recordings; ++r)
    for (int i = 0; i < 3; ++i) {
      if (asked.bias) free.free_own(r, i);
      if (asked.drift) free.free_own(r, i + 3);
    }
  return free;
}

FreeSet linear_set(const ModelState& state, std::size_t recordings, const Asked& asked) {
  return free_set(state, recordings, {asked.bias, asked.drift, false, false, asked.weight});
}

FreeSums total_of(const std::vector<NormalSums>& sums, const std::vector<Chunk>& chunks,
                  const FreeSet& free) {
  FreeSums total(free.size);
  for (std::size_t i = 0; i < chunks.size(); ++i)
    total.add(sums[i], free, static_cast<std::size_t>(chunks[i].recording));
  return total;
}

void filter_at(double time_constant, const FitOptions& options, const Asked& asked, FitData& data,
               ModelState& state) {
  data.lowpass = std::clamp(time_constant, 0.0, options.largest_lowpass);
  state.shared[kLowpass] = 0;
  tbb::parallel_for(std::size_t{0}, data.recordings.size(), [&](std::size_t r) {
    set_lowpass(data.recordings[r], data.lowpass, asked.lowpass);
  });
}

Mat3 rotation_matrix(const Vec3& vector) {
  const double angle = vector.norm();
  return angle > 0 ? Eigen::AngleAxisd(angle, vector / angle).toRotationMatrix()
                   : Mat3(Mat3::Identity());
}

}  // namespace toothprep
