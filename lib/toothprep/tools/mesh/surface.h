// Surfaces of a layered tooth: closed triangle meshes, oriented outward, in mm (W frame).
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

struct TriangleMesh {                                   // indexed; no vertex occurs twice
  std::vector<Eigen::Vector3f> vertices;                // mm
  std::vector<std::array<std::uint32_t, 3>> triangles;  // counter-clockwise seen from outside
  std::vector<std::uint8_t> tissue;                     // per vertex, a Tissue label
  // Per triangle, a Tissue label, where the triangles are divided by tissue (surface_by_tissue());
  // else empty.
  std::vector<std::uint8_t> triangle_tissue = {};
};

enum class SurfaceOf { kAll, kEnamel, kDentin, kPulp };  // the solid, or one tissue

// The zero surface of what remains of the whole tooth or of one tissue; closed and free of
// self-intersections. An empty mesh if nothing remains. `tissue` is the tissue under each vertex.
[[nodiscard]] TriangleMesh extract_surface(const LayeredTooth& tooth, SurfaceOf what);

// Numbers per vertex, and colours instead of those by tissue, for the formats that hold them: .ply
// (float properties) and .vtk (point data); .stl and .obj leave them out.
struct VertexAttributes {
  struct Scalar {               // one number per vertex
    std::string name;           // a word
    std::vector<float> values;  // per vertex
  };
  std::vector<Scalar> scalars;                       // in the order of the file
  std::vector<std::array<std::uint8_t, 3>> colours;  // RGB per vertex, or empty
};

// By extension: .ply (binary little endian, vertex property `tissue`), .stl (binary), .obj, .vtk
// (legacy binary polydata with the point data `tissue`, for ParaView). Tissues of triangles are the
// face property `tissue` of a .ply, the cell data `tissue` of a .vtk, and groups of an .obj. Throws Error for another
// extension, an empty mesh, or attributes that are not one per vertex. Writes `path` itself.
void write_mesh(const TriangleMesh& mesh, const std::string& path,
                const VertexAttributes& attributes = {});

// Throws Error unless the name ends in one of those extensions: to know before the work is done.
void check_mesh_name(const std::string& path);

[[nodiscard]] double mesh_volume_mm3(
    const TriangleMesh& mesh);  // signed, by the divergence theorem

}  // namespace toothprep
