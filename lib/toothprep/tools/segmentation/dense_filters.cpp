// All of Eigen stands before ITK, which brings an older copy of it with the same include guards.
#include "toothprep/tools/segmentation/dense_filters.h"

#include <itkConnectedComponentImageFilter.h>
#include <itkImportImageFilter.h>
#include <itkRelabelComponentImageFilter.h>
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
using LabelImage = itk::Image<std::uint32_t, 3>;

// A view of the array as an ITK image; ITK only reads it.
template <class T>
typename itk::ImportImageFilter<T, 3>::Pointer view(const Index3& size,
                                                    const std::vector<T>& values) {
  using Import = itk::ImportImageFilter<T, 3>;
  const auto import = Import::New();
  typename Import::RegionType region;
  for (unsigned a = 0; a < 3; ++a) region.SetSize(a, static_cast<std::size_t>(size[a]));
  import->SetRegion(region);
  import->SetImportPointer(const_cast<T*>(values.data()), values.size(), false);
  import->Update();
  return import;
}

template <class Filter>
void run(Filter& filter) {
  const auto threads = static_cast<itk::ThreadIdType>(
      tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism));
  filter.SetNumberOfWorkUnits(threads);
  filter.Update();
}

template <class Image>
auto copied(const Image& image, std::size_t voxels) {
  const auto* values = image.GetBufferPointer();
  return std::vector<typename Image::PixelType>(values, values + voxels);
}

std::vector<float> signed_maurer(const Index3& size, const Mask& mask) {
  const auto input = view(size, mask);
  const auto filter = itk::SignedMaurerDistanceMapImageFilter<MaskImage, FloatImage>::New();
  filter->SetInput(input->GetOutput());
  filter->SetBackgroundValue(0);
  filter->SetInsideIsPositive(false);
  filter->SetSquaredDistance(false);
  filter->SetUseImageSpacing(false);
  run(*filter);
  return copied(*filter->GetOutput(), mask.size());
}

}  // namespace

Components connected_components(const Index3& size, const Mask& mask) {
  Components result;
  const auto input = view(size, mask);
  const auto find = itk::ConnectedComponentImageFilter<MaskImage, LabelImage>::New();
  find->SetInput(input->GetOutput());
  find->SetBackgroundValue(0);
  find->FullyConnectedOff();
  run(*find);
  const auto sort = itk::RelabelComponentImageFilter<LabelImage, LabelImage>::New();
  sort->SetInput(find->GetOutput());
  sort->InPlaceOn();
  run(*sort);
  result.label = copied(*sort->GetOutput(), mask.size());
  for (const auto n : sort->GetSizeOfObjectsInPixels())
    result.voxels.push_back(static_cast<std::size_t>(n));
  result.at_edge.assign(result.voxels.size(), 0);
  std::size_t v = 0;
  for (int k = 0; k < size.z(); ++k)
    for (int j = 0; j < size.y(); ++j) {
      const bool edge_row = k == 0 || j == 0 || k == size.z() - 1 || j == size.y() - 1;
      for (int i = 0; i < size.x(); ++i, ++v)
        if ((edge_row || i == 0 || i == size.x() - 1) && result.label[v] != 0)
          result.at_edge[result.label[v] - 1] = 1;
    }
  return result;
}

void keep_largest_component(const Index3& size, Mask& mask) {
  const Components parts = connected_components(size, mask);
  for (std::size_t v = 0; v < mask.size(); ++v) mask[v] = parts.label[v] == 1;
}

void fill_enclosed(const Index3& size, Mask& mask) {
  Mask rest(mask.size());
  for (std::size_t v = 0; v < mask.size(); ++v) rest[v] = !mask[v];
  const Components parts = connected_components(size, rest);
  for (std::size_t v = 0; v < mask.size(); ++v)
    if (parts.label[v] != 0 && !parts.at_edge[parts.label[v] - 1]) mask[v] = 1;
}

std::vector<float> distance_to(const Index3& size, const Mask& mask) {
  if (std::find(mask.begin(), mask.end(), 1) == mask.end())
    return std::vector<float>(mask.size(), std::numeric_limits<float>::infinity());
  std::vector<float> distance = signed_maurer(size, mask);
  for (float& d : distance) d = std::max(d, 0.0f);
  return distance;
}

std::vector<float> depth_below_surface(const Index3& size, const Mask& mask) {
  // Maurer's distance is zero in the mask's outermost voxels, half a voxel below the surface.
  std::vector<float> depth = signed_maurer(size, mask);
  for (float& d : depth) d = 0.5f - d;
  return depth;
}

// Three passes of the sampled kernel, cut off at four sigma. (ITK's own discrete Gaussian does the
// same by a neighbourhood iterator and takes several times as long.)
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
  const auto inside = [](int i, int n) {
    return static_cast<std::size_t>(std::clamp(i, 0, n - 1));
  };
  std::vector<float> source;
  for (int axis = 0; axis < 3; ++axis) {
    source = values;
    tbb::parallel_for(0, size.z(), [&](int k) {
      std::vector<float> padded(row + 2 * static_cast<std::size_t>(radius));
      for (int j = 0; j < size.y(); ++j) {
        float* out =
            values.data() + static_cast<std::size_t>(k) * plane + static_cast<std::size_t>(j) * row;
        std::fill(out, out + row, 0.0f);
        const float* line =
            source.data() + static_cast<std::size_t>(k) * plane + static_cast<std::size_t>(j) * row;
        if (axis == 0)
          for (int i = 0; i < static_cast<int>(padded.size()); ++i)
            padded[static_cast<std::size_t>(i)] = line[inside(i - radius, size.x())];
        for (int d = -radius; d <= radius; ++d) {
          const float weight = kernel[static_cast<std::size_t>(d + radius)];
          const float* in = axis == 0   ? padded.data() + d + radius
                            : axis == 1 ? source.data() + static_cast<std::size_t>(k) * plane +
                                              inside(j + d, size.y()) * row
                                        : source.data() + inside(k + d, size.z()) * plane +
                                              static_cast<std::size_t>(j) * row;
          for (std::size_t i = 0; i < row; ++i) out[i] += weight * in[i];
        }
      }
    });
  }
}

}  // namespace toothprep
