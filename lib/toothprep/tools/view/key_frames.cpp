#include "toothprep/tools/view/key_frames.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace toothprep {
KeyFrames::KeyFrames(Workpiece& workpiece)
    : tooth_(workpiece.tooth()),
      first_(workpiece.cut()),
      cut_(first_),
      range_(blocks_of(first_)),
      versions_(first_.table_size()) {
  while (!workpiece.changed().empty()) workpiece.changed().take();
}

void KeyFrames::add(Workpiece& workpiece) {
  const LevelSet& cut = workpiece.cut();
  const std::lock_guard lock(guard_);
  while (!workpiece.changed().empty()) {
    const std::size_t brick = workpiece.changed().take();
    Version version{frames_, cut.is_uniform(brick), 0, 0};
    if (version.uniform) {
      version.value = cut.uniform_value(brick);
    } else {
      version.stored = values_.size();
      std::copy_n(cut.brick(brick), kBrickVoxels, values_.emplace_back().begin());
    }
    if (versions_[brick].empty()) changed_.push_back(brick);
    versions_[brick].push_back(version);
  }
  ++frames_;
}

int KeyFrames::frames() const {
  const std::lock_guard lock(guard_);
  return frames_;
}

std::size_t KeyFrames::bytes() const {
  const std::lock_guard lock(guard_);
  return values_.size() * sizeof(Values);
}

const KeyFrames::Version* KeyFrames::version(std::size_t brick, int frame) const {
  const std::vector<Version>& all = versions_[brick];
  const auto after = std::upper_bound(all.begin(), all.end(), frame,
                                      [](int f, const Version& v) { return f < v.since; });
  return after == all.begin() ? nullptr : &*(after - 1);
}

void KeyFrames::bring_cut_to(int frame) {
  for (const std::size_t brick : changed_) {
    const Version* wanted = version(brick, frame);
    if (wanted == version(brick, at_)) continue;
    // Stored also where it is uniform: a grid doesn't take the storage of such a brick back.
    float* values = cut_.writable_brick(brick);
    if (!wanted) {
      std::copy_n(first_.brick(brick), kBrickVoxels, values);
    } else if (wanted->uniform) {
      std::fill_n(values, kBrickVoxels, wanted->value);
    } else {
      std::copy_n(values_[wanted->stored].begin(), kBrickVoxels, values);
    }
  }
  at_ = frame;
}

std::vector<BlockMesh> KeyFrames::blocks(int frame, int seen) {
  std::vector<std::uint8_t> wanted(range_.size(), seen < 0 ? 1 : 0);
  {
    const std::lock_guard lock(guard_);
    bring_cut_to(frame);
    if (seen >= 0)
      for (const std::size_t brick : changed_) {
        if (version(brick, frame) == version(brick, seen)) continue;
        const Index3 origin = cut_.brick_origin(brick);
        const BlockRange touched =
            blocks_touched(range_, origin, origin + Index3::Constant(kBrickEdge - 1));
        for (std::size_t i = 0; i < touched.size(); ++i) wanted[range_.index(touched.block(i))] = 1;
      }
  }
  std::vector<std::size_t> to_mesh;
  for (std::size_t b = 0; b < wanted.size(); ++b)
    if (wanted[b]) to_mesh.push_back(b);
  std::vector<BlockMesh> meshes(to_mesh.size());
  tbb::enumerable_thread_specific<BlockMesher> meshers;
  tbb::parallel_for(std::size_t{0}, to_mesh.size(), [&](std::size_t i) {
    meshes[i] = meshers.local().mesh(tooth_, cut_, range_.block(to_mesh[i]));
  });
  if (seen < 0) std::erase_if(meshes, [](const BlockMesh& m) { return m.mesh.triangles.empty(); });
  return meshes;
}

}  // namespace toothprep
