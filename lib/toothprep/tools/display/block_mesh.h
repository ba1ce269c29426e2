// The surface of what remains, max(tooth, cut), block by block.
//
// Block b holds the cells whose lower corners are the voxels 32 b .. 32 b + 31 along each axis of
// the lattice, whatever the tooth's box. Its samples are 32 b .. 32 b + 32: the last plane is the
// next block's first. By the rules of step/tooth/cell_cases.h, which look at no more than the samples of
// a face, two blocks meshed apart have the same vertices and segments in the plane they share, bit
// by bit, so they join without cracks.
//
//   vertex   on the lattice edge between voxels of opposite sign, where the field, linear along the
//            edge, is zero (within the margin of cell_cases.h)
//   normal   the field's gradient by central differences at both ends of that edge, linear between
//            them, unit. It needs one sample more on every side, so that the normals of a shared
//            vertex are equal too. Where cut and tooth meet at a sharp edge it is rounded off over
//            a voxel.
//   tissue   the label under the vertex (step/tooth/tissue_under.h)
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

constexpr int kBlockCells = 32;  // per axis

// A surface in mm (W), indexed.
struct DisplayMesh {
  std::vector<Eigen::Vector3f> vertices;                // mm
  std::vector<Eigen::Vector3f> normals;                 // unit, outward
  std::vector<std::uint8_t> tissue;                     // per vertex, a Tissue label
  std::vector<std::array<std::uint32_t, 3>> triangles;  // counter-clockwise seen from outside
};

// One block's part of it; empty if the surface doesn't pass through the block.
struct BlockMesh {
  Index3 block = Index3::Zero();  // its first voxel is 32 * block
  std::uint64_t generation = 0;   // of its publication (display_surface.h)
  DisplayMesh mesh;
  // Per vertex its lattice edge: ((x * 33 + y) * 33 + z) * 3 + axis, from voxel (x, y, z) of the
  // block. What neighbours share they know by it.
  std::vector<std::uint32_t> edge;
};

// The blocks that can hold surface of a tooth whose grids cover these bricks.
struct BlockRange {
  Index3 first = Index3::Zero(), counts = Index3::Zero();

  std::size_t size() const {
    return static_cast<std::size_t>(counts.x()) * counts.y() * counts.z();
  }
  Index3 block(std::size_t index) const {
    const auto z = static_cast<int>(index % counts.z());
    const auto y = static_cast<int>(index / counts.z() % counts.y());
    const auto x = static_cast<int>(index / counts.z() / counts.y());
    return first + Index3(x, y, z);
  }
  std::size_t index(const Index3& block) const {
    const Index3 i = block - first;
    return (static_cast<std::size_t>(i.x()) * counts.y() + i.y()) * counts.z() + i.z();
  }
};
BlockRange blocks_of(const LevelSet& grid);
// Those of them whose mesh depends on a sample of the voxels lower .. upper (inclusive); counts are
// zero if none does.
BlockRange blocks_touched(const BlockRange& all, const Index3& lower, const Index3& upper);

// Meshes blocks one after the other; keeps the working memory (0.3 MB) between them.
class BlockMesher {
 public:
  BlockMesher();
  ~BlockMesher();
  BlockMesher(BlockMesher&&) noexcept;

  // `cut` lies on the tooth's bricks.
  BlockMesh mesh(const LayeredTooth& tooth, const LevelSet& cut, const Index3& block);

 private:
  struct Work;
  std::unique_ptr<Work> work_;
};

// All blocks as one mesh in which every vertex occurs once. Blocks of one moment in any order; the
// result depends on the order, so keep to one.
DisplayMesh join_blocks(const std::vector<std::shared_ptr<const BlockMesh>>& blocks);

}  // namespace toothprep
