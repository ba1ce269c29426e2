// All of Eigen stands before ITK, which brings an older copy of it with the same include guards.
#include "toothprep/tools/segmentation/dense_filters.h"

#include <itkImportImageFilter.h>
#include <itkSignedMaurerDistanceMapImageFilter.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "toothprep/tools/segmentation/wide_vectors.h"

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

// The kernel, cut off at four sigma.
std::vector<float> gaussian(double sigma) {
  const int radius = std::max(1, static_cast<int>(std::ceil(4 * sigma)));
  std::vector<float> kernel;
  double sum = 0;
  for (int d = -radius; d <= radius; ++d) sum += std::exp(-0.5 * d * d / (sigma * sigma));
  for (int d = -radius; d <= radius; ++d)
    kernel.push_back(static_cast<float>(std::exp(-0.5 * d * d / (sigma * sigma)) / sum));
  return kernel;
}

// out = the sum over d of kernel[d] * row d of `rows`; rows that are null hold zeros. A part of the
// row at a time, whose sums stay in registers. With `needed`, a one for each such part: the others are left
// as they are.
constexpr std::size_t kAtOnce = 16;
std::size_t row_parts(std::size_t length) { return (length + kAtOnce - 1) / kAtOnce; }
void sum_rows(const std::vector<const float*>& rows, const std::vector<float>& kernel,
              std::size_t length, const std::uint8_t* needed, float* out) {
  std::size_t i = 0;
  for (; i + kAtOnce <= length; i += kAtOnce) {
    if (needed && !needed[i / kAtOnce]) continue;
    std::array<float, kAtOnce> sum{};
    for (std::size_t d = 0; d < kernel.size(); ++d)
      if (rows[d])
        for (std::size_t n = 0; n < kAtOnce; ++n) sum[n] += kernel[d] * rows[d][i + n];
    std::copy(sum.begin(), sum.end(), out + i);
  }
  if (needed && i < length && !needed[i / kAtOnce]) return;
  for (; i < length; ++i) {
    float sum = 0;
    for (std::size_t d = 0; d < kernel.size(); ++d)
      if (rows[d]) sum += kernel[d] * rows[d][i];
    out[i] = sum;
  }
}

// What the passes over rows need; kept from one to the next.
struct Rows {
  std::vector<float> values;
  std::vector<const float*> at;
  std::vector<const float*> taps;
};

// Rows beside each other along one axis, in place; the first and the last are continued. Zeros cost
// nothing. `needed`: if not null, the parts of each row.
void smooth_rows(float* first, int count, std::size_t stride, std::size_t length,
                 const std::vector<float>& kernel, const std::uint8_t* needed, Rows& rows) {
  rows.values.resize(static_cast<std::size_t>(count) * length);
  rows.at.resize(static_cast<std::size_t>(count));
  rows.taps.resize(kernel.size());
  for (int r = 0; r < count; ++r) {
    const float* in = first + static_cast<std::size_t>(r) * stride;
    float* copy = rows.values.data() + static_cast<std::size_t>(r) * length;
    std::copy_n(in, length, copy);
    const bool zero = std::all_of(in, in + length, [](float x) { return x == 0; });
    rows.at[static_cast<std::size_t>(r)] = zero ? nullptr : copy;
  }
  const int radius = static_cast<int>(kernel.size() / 2);
  for (int r = 0; r < count; ++r) {
    for (int d = -radius; d <= radius; ++d)
      rows.taps[static_cast<std::size_t>(d + radius)] =
          rows.at[static_cast<std::size_t>(std::clamp(r + d, 0, count - 1))];
    sum_rows(rows.taps, kernel, length,
             needed ? needed + static_cast<std::size_t>(r) * row_parts(length) : nullptr,
             first + static_cast<std::size_t>(r) * stride);
  }
}

void smooth_along(float* row, std::size_t length, const std::vector<float>& kernel,
                  const std::uint8_t* needed, Rows& rows) {
  if (std::all_of(row, row + length, [](float x) { return x == 0; })) return;
  const std::size_t radius = kernel.size() / 2;
  rows.values.assign(length + 2 * radius, row[0]);
  std::copy_n(row, length, rows.values.data() + radius);
  std::fill(rows.values.data() + radius + length, rows.values.data() + rows.values.size(),
            row[length - 1]);
  rows.taps.resize(kernel.size());
  for (std::size_t d = 0; d < kernel.size(); ++d) rows.taps[d] = rows.values.data() + d;
  sum_rows(rows.taps, kernel, length, needed, row);
}

// Along x and y.
void smooth_plane(const Index3& size, float* plane, const std::vector<float>& kernel, Rows& rows) {
  const auto row = static_cast<std::size_t>(size.x());
  for (int j = 0; j < size.y(); ++j)
    smooth_along(plane + static_cast<std::size_t>(j) * row, row, kernel, nullptr, rows);
  smooth_rows(plane, size.y(), row, row, kernel, nullptr, rows);
}

// Which parts of a plane's rows are needed for a field's values.
class NeededParts {
 public:
  NeededParts(const Index3& size, const BandField& field, int radius)
      : size_(size), radius_(radius), parts_(row_parts(static_cast<std::size_t>(size.x()))) {
    const auto row = static_cast<std::size_t>(size.x());
    rows_.resize(static_cast<std::size_t>(size.y()) * static_cast<std::size_t>(size.z()) * parts_);
    for (std::size_t n = 0; n < rows_.size(); ++n) {
      const std::size_t first = n / parts_ * row + n % parts_ * kAtOnce,
                        end = std::min(first + kAtOnce, (n / parts_ + 1) * row);
      rows_[n] = field.has(first) || field.has(end - 1);
    }
  }

  // Along x and y.
  void smooth(int k, float* plane, const std::vector<float>& kernel, Rows& rows) const {
    const std::size_t area = static_cast<std::size_t>(size_.y()) * parts_;
    const Mask across = around(rows_.data(), k, size_.z(), area);
    const auto row = static_cast<std::size_t>(size_.x());
    for (int j = 0; j < size_.y(); ++j)
      smooth_along(plane + static_cast<std::size_t>(j) * row, row, kernel,
                   around(across.data(), j, size_.y(), parts_).data(), rows);
    smooth_rows(plane, size_.y(), row, row, kernel, across.data(), rows);
  }

 private:
  // In one of the `count` things of that length within the radius of one of them.
  Mask around(const std::uint8_t* first, int at, int count, std::size_t length) const {
    Mask any(length);
    for (int n = std::max(0, at - radius_); n <= std::min(count - 1, at + radius_); ++n)
      for (std::size_t i = 0; i < length; ++i)
        any[i] |= first[static_cast<std::size_t>(n) * length + i];
    return any;
  }

  Index3 size_;
  int radius_;
  std::size_t parts_;
  Mask rows_;
};

}  // namespace

// Three passes of the sampled kernel, in place. (ITK's own discrete Gaussian does the same by a
// neighbourhood iterator and takes several times as long.)
void smooth(const Index3& size, std::vector<float>& values, double sigma) {
  if (!(sigma > 0)) return;
  const std::vector<float> kernel = gaussian(sigma);
  const auto row = static_cast<std::size_t>(size.x());
  const std::size_t plane = row * static_cast<std::size_t>(size.y());
  tbb::parallel_for(0, size.z(), [&](int k) {
    Rows rows;
    with_wide_vectors([&] {
      smooth_plane(size, values.data() + static_cast<std::size_t>(k) * plane, kernel, rows);
    });
  });
  tbb::parallel_for(0, size.y(), [&](int j) {
    Rows rows;
    with_wide_vectors([&] {
      smooth_rows(values.data() + static_cast<std::size_t>(j) * row, size.z(), plane, row, kernel,
                  nullptr, rows);
    });
  });
}

void smooth_where(const Index3& size, double sigma, const BandField& field,
                  const std::function<void(int k, float* plane)>& fill,
                  const std::function<void(std::size_t v, float value)>& take) {
  const std::vector<float> kernel = gaussian(sigma);
  const int radius = static_cast<int>(kernel.size() / 2);
  const std::size_t area = static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(size.y());
  const NeededParts needed_parts(size, field, radius);
  constexpr int kPlanes = BandField::kChunk;  // so that a chunk never lies in two parts
  std::vector<std::vector<float>> planes(static_cast<std::size_t>(size.z()));  // those in use
  int ready = 0;
  for (int first = 0; first < size.z(); first += kPlanes) {
    const int end = std::min(size.z(), first + kPlanes), needed = std::min(size.z(), end + radius);
    tbb::parallel_for(ready, needed, [&](int k) {
      std::vector<float>& plane = planes[static_cast<std::size_t>(k)];
      plane.resize(area);
      fill(k, plane.data());
      Rows rows;
      with_wide_vectors([&] { needed_parts.smooth(k, plane.data(), kernel, rows); });
    });
    ready = needed;
    tbb::parallel_for(first, end, [&](int k) {
      std::vector<const float*> taps(kernel.size());
      std::array<float, BandField::kChunk> sum;
      const std::size_t begin = static_cast<std::size_t>(k) * area;
      for (std::size_t v = begin; v < begin + area;) {
        const std::size_t next =
            std::min(begin + area, (v / BandField::kChunk + 1) * BandField::kChunk);
        if (field.has(v)) {
          for (int d = -radius; d <= radius; ++d)
            taps[static_cast<std::size_t>(d + radius)] =
                planes[static_cast<std::size_t>(std::clamp(k + d, 0, size.z() - 1))].data() +
                (v - begin);
          with_wide_vectors([&] { sum_rows(taps, kernel, next - v, nullptr, sum.data()); });
          for (std::size_t u = v; u < next; ++u) take(u, sum[u - v]);
        }
        v = next;
      }
    });
    for (int k = std::max(0, first - radius); k < end - radius; ++k)
      std::vector<float>().swap(planes[static_cast<std::size_t>(k)]);
  }
}

}  // namespace toothprep
