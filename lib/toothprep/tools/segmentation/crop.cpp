#include "toothprep/tools/segmentation/crop.h"

#include <algorithm>
#include <string>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

class Part : public ScanSource {
 public:
  Part(std::unique_ptr<ScanSource> whole, const VoxelRange& part)
      : ScanSource(whole->path(), frame_of(whole->frame(), part)),
        whole_(std::move(whole)),
        first_(part.first) {}

  void read(int first, int count, float* values) override {
    VoxelRange slices = whole_of(frame());
    slices.first.z() = first;
    slices.last.z() = first + count - 1;
    read_part(slices, values);
  }

  void read_part(const VoxelRange& part, float* values) override {
    whole_->read_part({first_ + part.first, first_ + part.last}, values);
  }

  std::size_t voxels_at_once() const override { return whole_->voxels_at_once(); }
  double whole_up_to() const override { return whole_->whole_up_to(); }

  void check_rest() override { whole_->check_rest(); }

  std::vector<std::string> notes() const override { return whole_->notes(); }

 private:
  std::unique_ptr<ScanSource> whole_;
  Index3 first_;
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
