// A scan's values, some slices at a time: what a scan needs in memory does not grow with its
// length.
#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "toothprep/tools/io/image_volume.h"

namespace toothprep {

// A box of an image's voxels.
struct VoxelRange {
  Index3 first, last;  // inclusive
  // How many along each axis.
  [[nodiscard]] Index3 size() const { return last - first + Index3::Ones(); }
};

class ScanSource {  // a scan that is read slab by slab
 public:
  virtual ~ScanSource() = default;
  ScanSource(const ScanSource&) = delete;
  ScanSource& operator=(const ScanSource&) = delete;

  // Where the values stand: LPS, mm.
  const ImageFrame& frame() const { return frame_; }

  // Slices `first` .. `first + count - 1` along the image's third axis, x fastest, to `values`
  // (count * size.x * size.y). Going up through the slices is what every source does at its best.
  // Throws InputError for values that are not there or cannot be decoded.
  virtual void read(int first, int count, float* values) = 0;

  // Of these slices only the part's voxels, x fastest.
  virtual void read_part(const VoxelRange& part, float* values);

  // So many are best read at a time: slices enough to be decoded side by side, or few enough to stay in the
  // processor's cache.
  [[nodiscard]] virtual std::size_t voxels_at_once() const;

  // All values are whole numbers of at most this magnitude; infinity where that isn't known.
  [[nodiscard]] virtual double whole_up_to() const {
    return std::numeric_limits<double>::infinity();
  }

  // Throws InputError if what was not read shows damage: the end of a compressed stream, with its
  // checksum. For after the last slice that is read.
  virtual void check_rest() {}

  // What was changed or assumed, a sentence each; complete once all slices were read.
  virtual std::vector<std::string> notes() const { return {}; }

  const std::string& path() const { return path_; }  // for messages

 protected:
  ScanSource(std::string path, ImageFrame frame)
      : path_(std::move(path)), frame_(std::move(frame)) {}  // of what derives from it

 private:
  std::string path_;
  ImageFrame frame_;
};

// The whole scan.
VoxelRange whole_of(const ImageFrame& scan);

// A volume that is in memory already; it must live as long as what is returned.
std::unique_ptr<ScanSource> source_of(const ImageVolume<float>& volume, std::string path = {});

// One that holds its volume.
std::unique_ptr<ScanSource> owning_source(ImageVolume<float> volume, std::string path,
                                          std::vector<std::string> notes = {});

// visit(first, count, values) for all slices, upwards, in slabs of a few dozen MB at most; the calls' slabs
// differ only in how the slices are grouped. `progress` gets the share that is read (0..1).
// Throws InputError for more than 2^31 voxels, and after the last slab if a value was NaN or infinite
// or the rest of the file shows damage.
using VisitSlab = std::function<void(int first, int count, const float* values)>;
void for_each_slab(ScanSource& source, const VisitSlab& visit,
                   const std::function<void(double)>& progress = {});

// The same of a part only: visit() gets the part's voxels, of slices counted from the scan's first. The values are
// not checked.
void for_each_slab(ScanSource& source, const VoxelRange& part, const VisitSlab& visit,
                   const std::function<void(double)>& progress = {});

// All of it at once; checked as for_each_slab does.
[[nodiscard]] ImageVolume<float> read_all(ScanSource& source);

// As labels; throws InputError too if a value is not an integer in 0..65535.
[[nodiscard]] ImageVolume<std::uint16_t> read_labels(ScanSource& source);

}  // namespace toothprep
