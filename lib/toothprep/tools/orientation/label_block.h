// A tooth's labels in a dense box: what the frame is found from.
#pragma once

#include <cstdint>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// Every n-th voxel's label, with an empty margin of one cell, so that neighbours always exist.
struct LabelBlock {
  Index3 size = Index3::Zero();     // cells
  Vec3 origin = Vec3::Zero();       // mm, W: the middle of cell 0
  double step = 0;                  // mm
  std::vector<std::uint8_t> label;  // Tissue values, x slowest

  std::size_t index(int x, int y, int z) const {
    return (static_cast<std::size_t>(x) * size.y() + y) * size.z() + z;
  }
  Index3 cell(std::size_t at) const {
    const auto z = static_cast<int>(at % size.z()), y = static_cast<int>(at / size.z() % size.y());
    return {static_cast<int>(at / size.z() / size.y()), y, z};
  }
  Vec3 place(std::size_t at) const { return origin + step * cell(at).cast<double>(); }  // mm, W
  Tissue at(std::size_t n) const { return static_cast<Tissue>(label[n]); }
  // Whether one of the 26 cells around has the label; not for cells of the margin.
  bool beside(std::size_t n, Tissue tissue) const;
};

// The anatomy of the tooth: enamel, dentin, pulp and `other` as labelled, cut or not. About
// `cells` cells along the longest edge, but never finer than the voxels. Empty for an empty tooth.
LabelBlock label_block(const LayeredTooth& tooth, int cells);

// Sizes of the connected pieces of dentin and pulp together, the largest first, in cells.
std::vector<std::size_t> dentin_pieces(const LabelBlock& block);

}  // namespace toothprep
