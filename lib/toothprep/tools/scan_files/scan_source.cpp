#include "toothprep/tools/scan_files/scan_source.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <mutex>
#include <optional>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/scan_files/image_checks.h"

namespace toothprep {
namespace {

constexpr std::size_t kSlabVoxels = std::size_t{1} << 23;  // 32 MB of values
constexpr std::uint32_t kNotFinite = 0x7f800000;           // exponent of NaN and infinity

class InMemory : public ScanSource {
 public:
  InMemory(const ImageVolume<float>& volume, std::string path)
      : ScanSource(std::move(path), volume), volume_(volume) {}
  void read(int first, int count, float* values) override {
    const float* from = volume_.data.data() + volume_.offset(0, 0, first);
    std::copy_n(from, volume_.offset(0, 0, count), values);
  }

 private:
  const ImageVolume<float>& volume_;
};

// Throws InputError if all voxels at once, with so many bytes each, are too much.
void check_memory_for(const ScanSource& source, std::size_t bytes) {
  image::check_voxels(source.path(), source.frame().size);
  require_memory(source.path(), "size",
                 static_cast<double>(source.frame().voxels()) * static_cast<double>(bytes),
                 "read a part of it with --roi, or coarsen it");
}

struct Held {  // stands before the base that refers to it
  ImageVolume<float> volume;
};

class Owning : private Held, public InMemory {
 public:
  Owning(ImageVolume<float> held, std::string path, std::vector<std::string> notes)
      : Held{std::move(held)}, InMemory(Held::volume, std::move(path)), notes_(std::move(notes)) {}
  std::vector<std::string> notes() const override { return notes_; }

 private:
  std::vector<std::string> notes_;
};

}  // namespace

std::size_t ScanSource::voxels_at_once() const { return kSlabVoxels; }

void ScanSource::read_part(const VoxelRange& part, float* values) {
  const Index3 all = frame_.size, size = part.size();
  if (size.x() == all.x() && size.y() == all.y()) return read(part.first.z(), size.z(), values);
  const std::size_t area = static_cast<std::size_t>(all.x()) * all.y();
  // Of wide slices, of which little is wanted, only few at a time.
  const int most = std::clamp(static_cast<int>(kSlabVoxels / area), 1, size.z());
  std::vector<float> slices(area * static_cast<std::size_t>(most));
  for (int done = 0; done < size.z(); done += most) {
    const int some = std::min(most, size.z() - done);
    read(part.first.z() + done, some, slices.data());
    for (int k = 0; k < some; ++k)
      for (int j = 0; j < size.y(); ++j, values += size.x())
        std::copy_n(slices.data() + static_cast<std::size_t>(k) * area +
                        static_cast<std::size_t>(part.first.y() + j) * all.x() + part.first.x(),
                    size.x(), values);
  }
}

VoxelRange whole_of(const ImageFrame& scan) { return {Index3::Zero(), scan.size - Index3::Ones()}; }

std::unique_ptr<ScanSource> source_of(const ImageVolume<float>& volume, std::string path) {
  return std::make_unique<InMemory>(volume, std::move(path));
}

std::unique_ptr<ScanSource> owning_source(ImageVolume<float> volume, std::string path,
                                          std::vector<std::string> notes) {
  return std::make_unique<Owning>(std::move(volume), std::move(path), std::move(notes));
}

void for_each_slab(ScanSource& source, const VoxelRange& part, const VisitSlab& visit,
                   const std::function<void(double)>& progress) {
  const Index3 size = part.size();
  const std::size_t area = static_cast<std::size_t>(size.x()) * size.y();
  const int thickness = std::clamp(static_cast<int>(source.voxels_at_once() / area), 1, size.z());
  std::vector<float> values(area * static_cast<std::size_t>(thickness));
  VoxelRange slab = part;
  for (int& k = slab.first.z(); k <= part.last.z(); k += thickness) {
    if (progress) progress(static_cast<double>(k - part.first.z()) / size.z());
    slab.last.z() = std::min(k + thickness - 1, part.last.z());
    source.read_part(slab, values.data());
    visit(k, slab.size().z(), values.data());
  }
}

void for_each_slab(ScanSource& source, const VisitSlab& visit,
                   const std::function<void(double)>& progress) {
  const Index3 size = source.frame().size;
  image::check_voxels(source.path(), size);
  const std::size_t area = static_cast<std::size_t>(size.x()) * size.y();
  std::atomic<std::size_t> bad = 0;
  const bool finite = std::isfinite(source.whole_up_to());
  for_each_slab(
      source, whole_of(source.frame()),
      [&](int first, int count, const float* values) {
        tbb::parallel_for(0, finite ? 0 : count, [&](int k) {
          const float* slice = values + static_cast<std::size_t>(k) * area;
          std::size_t found = 0;  // by the exponent's bits: this way the loop is a vector's
          for (std::size_t v = 0; v < area; ++v)
            found += (std::bit_cast<std::uint32_t>(slice[v]) & kNotFinite) == kNotFinite;
          bad += found;
        });
        visit(first, count, values);
      },
      progress);
  source.check_rest();
  if (bad > 0)
    throw InputError(source.path(), "voxel data",
                     std::to_string(bad) + " of " + std::to_string(source.frame().voxels()) +
                         " values are not finite numbers",
                     "replace them by the grey value of the surroundings");
}

ImageVolume<float> read_all(ScanSource& source) {
  ImageVolume<float> volume;
  static_cast<ImageFrame&>(volume) = source.frame();
  check_memory_for(source, sizeof(float));
  volume.data.reserve(volume.voxels());
  const std::size_t area = volume.offset(0, 0, 1);
  for_each_slab(source, [&](int, int count, const float* values) {
    volume.data.insert(volume.data.end(), values, values + area * static_cast<std::size_t>(count));
  });
  return volume;
}

ImageVolume<std::uint16_t> read_labels(ScanSource& source) {
  ImageVolume<std::uint16_t> labels;
  static_cast<ImageFrame&>(labels) = source.frame();
  check_memory_for(source, sizeof(std::uint16_t));
  labels.data.resize(labels.voxels());
  const std::size_t area = labels.offset(0, 0, 1);
  std::mutex lock;
  std::optional<float> wrong;
  for_each_slab(source, [&](int first, int count, const float* values) {
    tbb::parallel_for(0, count, [&](int k) {
      const float* from = values + area * static_cast<std::size_t>(k);
      std::uint16_t* to = labels.data.data() + labels.offset(0, 0, first + k);
      for (std::size_t v = 0; v < area; ++v) {
        if (!std::isfinite(from[v])) continue;  // said when all were read
        const auto label = static_cast<std::uint16_t>(std::clamp(from[v], 0.0f, 65535.0f));
        if (static_cast<float>(label) != from[v]) {
          const std::scoped_lock guard(lock);
          if (!wrong) wrong = from[v];
          return;
        }
        to[v] = label;
      }
    });
  });
  if (wrong)
    throw InputError(source.path(), "voxel data",
                     "holds the value " + image::number(*wrong) + ", which is no label",
                     "labels are integers in 0..65535; a grey scan goes without --labels");
  return labels;
}

}  // namespace toothprep
