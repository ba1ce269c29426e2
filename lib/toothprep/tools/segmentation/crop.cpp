#include "toothprep/tools/segmentation/crop.h"

#include <algorithm>
#include <string>
#include <vector>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

constexpr std::size_t kValuesAtOnce = std::size_t{1} << 23;  // 32 MB

class Part : public ScanSource {
 public:
  Part(std::unique_ptr<ScanSource> whole, const VoxelRange& part)
      : ScanSource(whole->path(), frame_of(whole->frame(), part)),
        whole_(std::move(whole)),
        first_(part.first) {}

  void read(int first, int count, float* values) override {
    const Index3 all = whole_->frame().size, size = frame().size;
    const std::size_t area = static_cast<std::size_t>(all.x()) * all.y();
    // Of wide slices, of which little is wanted, only few at a time.
    const int most = std::max(1, static_cast<int>(kValuesAtOnce / area));
    for (int done = 0; done < count; done += most) {
      const int some = std::min(most, count - done);
      slices_.resize(area * static_cast<std::size_t>(some));
      whole_->read(first_.z() + first + done, some, slices_.data());
      for (int k = 0; k < some; ++k)
        for (int j = 0; j < size.y(); ++j, values += size.x())
          std::copy_n(slices_.data() + static_cast<std::size_t>(k) * area +
                          static_cast<std::size_t>(first_.y() + j) * all.x() + first_.x(),
                      size.x(), values);
    }
  }

  void check_rest() override { whole_->check_rest(); }

  std::vector<std::string> notes() const override { return whole_->notes(); }

 private:
  std::unique_ptr<ScanSource> whole_;
  Index3 first_;
  std::vector<float> slices_;
};

}  // namespace

VoxelRange voxels_around(const ImageFrame& image, const Box& box) {
  Vec3 low = Vec3::Constant(1e300), high = Vec3::Constant(-1e300);
  for (int c = 0; c < 8; ++c) {
    const Vec3 corner(c & 1 ? box.max.x() : box.min.x(), c & 2 ? box.max.y() : box.min.y(),
                      c & 4 ? box.max.z() : box.min.z());
    const Vec3 at = image.to_index() * (corner - image.origin);
    low = low.cwiseMin(at);
    high = high.cwiseMax(at);
  }
  VoxelRange range;
  for (int a = 0; a < 3; ++a) {
    const double top = image.size[a] - 1.0;
    range.first[a] = static_cast<int>(std::clamp(std::floor(low[a]), 0.0, top));
    range.last[a] = static_cast<int>(std::clamp(std::ceil(high[a]), 0.0, top));
  }
  return range;
}

ImageFrame frame_of(const ImageFrame& image, const VoxelRange& part) {
  ImageFrame frame = image;
  frame.size = part.size();
  frame.origin = image.to_world(part.first.cast<double>());
  return frame;
}

std::unique_ptr<ScanSource> crop(std::unique_ptr<ScanSource> scan, const Box& box) {
  if (!box.min.allFinite() || !box.max.allFinite() || !(box.min.array() < box.max.array()).all())
    throw Error("region: its lower corner must lie below its upper one along every axis");
  const VoxelRange part = voxels_around(scan->frame(), box);
  for (int a = 0; a < 3; ++a)
    if (part.size()[a] < 2)
      throw Error("region: less than two voxels of the scan lie in it along axis " +
                  std::to_string(a + 1) + "; it is given in mm, in the scan's frame (LPS)");
  return std::make_unique<Part>(std::move(scan), part);
}

}  // namespace toothprep
