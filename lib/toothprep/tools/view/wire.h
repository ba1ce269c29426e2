// What goes to the page as bytes, little-endian. page/data.js reads it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "toothprep/step/core/step_record.h"
#include "toothprep/tools/display/block_mesh.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

// ---- Surfaces, in blocks that replace those of the same place
//
//   int32 frame, number of blocks; of each block
//     int32    x, y, z of the block, vertices, triangles
//     float32  3 per vertex: place, mm, W
//     int16    4 per vertex: normal times 32767, tissue + 8 d: d = 0, or the deviation as
//              2048 + 2047 (deviation / kDeviationColourLimit), 1 to 4095
//     uint32   3 per triangle
class BlockBytes {
 public:
  explicit BlockBytes(std::int32_t frame);
  void add(const BlockMesh& block);
  // A whole mesh as one block, with corners of their own where a sharp edge needs two normals.
  // `deviation`: mm per vertex, NaN where it isn't known; or empty.
  void add(const TriangleMesh& mesh, const std::vector<float>& deviation = {});
  std::string take();  // the bytes

 private:
  std::string bytes_;
  std::int32_t blocks_ = 0;
};

// ---- A step: float32 of each column

struct ViewRow {                       // what the page knows of a step
  const StepRecord* step;              // of the session
  std::uint32_t flags = 0, fault = 0;  // of a live tick (core/live_tick.h)
  std::int64_t missed = 0;             // ticks so far
  // Of a second device, its own frame; not a number: there is none. Null: no such columns.
  const Pose* mirror = nullptr;
};
// Names, in order; with those of a second device.
[[nodiscard]] std::vector<std::string_view> row_columns(bool mirror);
void append_row(const ViewRow& row, std::string& bytes);

// A vertex's tissue and deviation as above.
[[nodiscard]] std::int16_t vertex_code(std::uint8_t tissue, float deviation_mm);

template <class T>
void append_bytes(const T& value, std::string& bytes) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
}

}  // namespace toothprep
