#include "toothprep/tools/mesh/crease_vertices.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <set>
#include <utility>

#include "toothprep/tools/mesh/crossing_triangles.h"

namespace toothprep {
namespace {

constexpr double kBackStep = 0.25;  // of the way from a cell to a crease beyond it
constexpr double kOutward = 0.1;    // cosine between a triangle and a face of the cut about it

using FloatBox = Eigen::AlignedBox3f;
FloatBox box_of(const TriangleMesh& mesh, std::size_t t) {
  FloatBox box;
  for (const std::uint32_t v : mesh.triangles[t]) box.extend(mesh.vertices[v]);
  return box;
}

}  // namespace

CreaseVertices::CreaseVertices(TriangleMesh& mesh, const Lattice& lattice, const Fields& fields,
                               std::vector<std::size_t> first_triangle)
    : mesh_(mesh), lattice_(lattice), fields_(fields), first_triangle_(std::move(first_triangle)) {}

void CreaseVertices::add(std::uint32_t vertex, const Index3& cell, const Crease& crease) {
  vertices_.push_back({vertex, cell, &crease, crease.at == crease.within ? 0.0 : 1.0});
}

void CreaseVertices::keep_clear() {
  for (bool moved = true; moved;) {
    moved = false;
    for (Its& its : vertices_) {
      if (its.beyond == 0) continue;
      const About near = about(its);
      if (!crosses(near) && !sticks_out(near, *its.crease)) continue;
      its.beyond -= kBackStep;
      move(its, its.crease->within + its.beyond * (its.crease->at - its.crease->within));
      moved = true;
    }
  }
  for (const Its& its : vertices_) {
    if (its.beyond > 0) continue;
    if (const About near = about(its); sticks_out(near, *its.crease))
      move(its, middle_of_border(its, near));
  }
}

// Those with this corner, and those of the bricks around that may meet them.
CreaseVertices::About CreaseVertices::about(const Its& its) const {
  constexpr double kTriangleReach = 2.5;  // of a vertex, voxels
  std::set<std::size_t> bricks;
  for (int n = 0; n < 27; ++n) {
    const Index3 side(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
    const Vec3 there = its.crease->within + kTriangleReach * side.cast<double>();
    if (const auto b = fields_.brick_of(there.array().floor().cast<int>())) bricks.insert(*b);
  }
  About about;
  FloatBox box;
  for (const std::size_t b : bricks)
    for (std::size_t t = first_triangle_[b]; t < first_triangle_[b + 1]; ++t) {
      const auto& corners = mesh_.triangles[t];
      const bool own = std::find(corners.begin(), corners.end(), its.vertex) != corners.end();
      (own ? about.own : about.others).push_back(t);
      if (own) box.extend(box_of(mesh_, t));
    }
  std::erase_if(about.others, [&](std::size_t t) { return !box.intersects(box_of(mesh_, t)); });
  return about;
}

bool CreaseVertices::crosses(const About& about) const {
  for (std::size_t k = 0; k < about.own.size(); ++k) {
    for (std::size_t other = k + 1; other < about.own.size(); ++other)
      if (cross(mesh_, about.own[k], about.own[other])) return true;
    for (const std::size_t t : about.others)
      if (cross(mesh_, about.own[k], t)) return true;
  }
  return false;
}

// Whether a triangle looks elsewhere than all of the cut does there.
bool CreaseVertices::sticks_out(const About& about, const Crease& crease) const {
  return std::any_of(about.own.begin(), about.own.end(), [&](std::size_t t) {
    std::array<Vec3, 3> at;
    for (int k = 0; k < 3; ++k) at[k] = mesh_.vertices[mesh_.triangles[t][k]].cast<double>();
    const Vec3 inward = (at[2] - at[0]).cross(at[1] - at[0]).normalized();
    return std::none_of(crease.normals.begin(), crease.normals.end(),
                        [&](const Vec3& normal) { return inward.dot(normal) > kOutward; });
  });
}

Vec3 CreaseVertices::middle_of_border(const Its& its, const About& about) const {
  Vec3 sum = Vec3::Zero();
  int count = 0;
  for (const std::size_t t : about.own)
    for (const std::uint32_t v : mesh_.triangles[t]) {
      const Vec3 in = lattice_.to_index(mesh_.vertices[v].cast<double>()) - its.cell.cast<double>();
      if (v == its.vertex || in.minCoeff() < -1e-3 || in.maxCoeff() > 1 + 1e-3) continue;
      sum += in;
      ++count;
    }
  return count == 0 ? its.crease->within : Vec3(its.cell.cast<double>() + sum / count);
}

void CreaseVertices::move(const Its& its, const Vec3& to) {
  mesh_.vertices[its.vertex] = (lattice_.origin + lattice_.voxel * to).cast<float>();
}

}  // namespace toothprep
