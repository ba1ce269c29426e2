// All of Eigen stands before ITK, which brings an older copy of it with the same include guards.
#include "toothprep/tools/segmentation/dense_filters.h"

#include <itkImportImageFilter.h>
#include <itkSignedMaurerDistanceMapImageFilter.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

namespace toothprep {
namespace {

using MaskImage = itk::Image<std::uint8_t, 3>;
using FloatImage = itk::Image<float, 3>;

// A view of the mask as an ITK image; ITK only reads it.
auto view(const Index3& size, const Mask& mask) {
  using Import = itk::ImportImageFilter<std::uint8_t, 3>;
  const auto import = Import::New();
  Import::RegionType region;
  for (unsigned a = 0; a < 3; ++a) region.SetSize(a, static_cast<std::size_t>(size[a]));
  import->SetRegion(region);
  import->SetImportPointer(const_cast<std::uint8_t*>(mask.data()), mask.size(), false);
  import->Update();
  return import;
}

std::vector<float> signed_maurer(const Index3& size, const Mask& mask) {
  const auto input = view(size, mask);
  const auto filter = itk::SignedMaurerDistanceMapImageFilter<MaskImage, FloatImage>::New();
  filter->SetInput(input->GetOutput());
  filter->SetBackgroundValue(0);
  filter->SetInsideIsPositive(false);
  filter->SetSquaredDistance(false);
  filter->SetUseImageSpacing(false);
  filter->SetNumberOfWorkUnits(static_cast<itk::ThreadIdType>(
      tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism)));
  filter->Update();
  const float* values = filter->GetOutput()->GetBufferPointer();
  return std::vector<float>(values, values + mask.size());
}

}  // namespace

std::vector<float> distance_to(const Index3& size, const Mask& mask) {
  if (std::find(mask.begin(), mask.end(), 1) == mask.end())
    return std::vector<float>(mask.size(), std::numeric_limits<float>::infinity());
  std::vector<float> distance = signed_maurer(size, mask);
  for (float& d : distance) d = std::max(d, 0.0f);
  return distance;
}

namespace {

// out = the sum over d of weight[d] * in row r + d. The rows, beside each other along one axis, lie
// one after another in `rows`; the first and the last are continued.
void sum_rows(const std::vector<float>& rows, int count, std::size_t length, int r,
              const std::vector<float>& kernel, float* out) {
  const int radius = static_cast<int>(kernel.size() / 2);
  std::fill(out, out + length, 0.0f);
  for (int d = -radius; d <= radius; ++d) {
    const float weight = kernel[static_cast<std::size_t>(d + radius)];
    const float* in =
        rows.data() + static_cast<std::size_t>(std::clamp(r + d, 0, count - 1)) * length;
    for (std::size_t i = 0; i < length; ++i) out[i] += weight * in[i];
  }
}

void smooth_rows(float* first, int count, std::size_t stride, std::size_t length,
                 const std::vector<float>& kernel) {
  std::vector<float> rows(static_cast<std::size_t>(count) * length);
  for (int r = 0; r < count; ++r)
    std::copy_n(first + static_cast<std::size_t>(r) * stride, length,
                rows.data() + static_cast<std::size_t>(r) * length);
  for (int r = 0; r < count; ++r)
    sum_rows(rows, count, length, r, kernel, first + static_cast<std::size_t>(r) * stride);
}

void smooth_along(float* row, std::size_t length, const std::vector<float>& kernel,
                  std::vector<float>& padded) {
  const std::size_t radius = kernel.size() / 2;
  padded.assign(length + 2 * radius, row[0]);
  std::copy_n(row, length, padded.data() + radius);
  std::fill(padded.data() + radius + length, padded.data() + padded.size(), row[length - 1]);
  std::fill(row, row + length, 0.0f);
  for (std::size_t d = 0; d < kernel.size(); ++d)
    for (std::size_t i = 0; i < length; ++i) row[i] += kernel[d] * padded[i + d];
}

}  // namespace

// Three passes of the sampled kernel, cut off at four sigma, in place. (ITK's own discrete Gaussian
// does the same by a neighbourhood iterator and takes several times as long.)
void smooth(const Index3& size, std::vector<float>& values, double sigma) {
  if (!(sigma > 0)) return;
  const int radius = std::max(1, static_cast<int>(std::ceil(4 * sigma)));
  std::vector<float> kernel;
  double sum = 0;
  for (int d = -radius; d <= radius; ++d) sum += std::exp(-0.5 * d * d / (sigma * sigma));
  for (int d = -radius; d <= radius; ++d)
    kernel.push_back(static_cast<float>(std::exp(-0.5 * d * d / (sigma * sigma)) / sum));

  const auto row = static_cast<std::size_t>(size.x());
  const std::size_t plane = row * static_cast<std::size_t>(size.y());
  tbb::parallel_for(0, size.z(), [&](int k) {
    float* first = values.data() + static_cast<std::size_t>(k) * plane;
    std::vector<float> padded;
    for (int j = 0; j < size.y(); ++j)
      smooth_along(first + static_cast<std::size_t>(j) * row, row, kernel, padded);
    smooth_rows(first, size.y(), row, row, kernel);
  });
  tbb::parallel_for(0, size.y(), [&](int j) {
    smooth_rows(values.data() + static_cast<std::size_t>(j) * row, size.z(), plane, row, kernel);
  });
}

}  // namespace toothprep
