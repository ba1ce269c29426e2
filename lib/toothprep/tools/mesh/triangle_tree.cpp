// Embree finds the triangle in single precision; where on it, and how far away, is then computed in
// double precision from the mesh's coordinates, which are exact relative to the local origin.
#include "toothprep/tools/mesh/triangle_tree.h"

#if TOOTHPREP_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <string>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/mesh/nearest_in_triangle.h"

namespace toothprep {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// A hit this close to an edge (as a weight) may as well be its neighbour's.
constexpr double kEdgeZone = 1e-4;
// How far outside of a triangle (as a weight) a hit on its edge may be computed to lie.
constexpr double kEdgeSlack = 1e-9;

Vec3 weighted(const Corners& c, const Vec3& w) { return w[0] * c[0] + w[1] * c[1] + w[2] * c[2]; }

struct RayHit {
  double distance = 0;
  Vec3 weights = Vec3::UnitX();
};

// Where a line meets the triangle's plane; nothing if it runs (almost) along the plane.
std::optional<RayHit> meet_plane(const Corners& c, const Vec3& origin, const Vec3& direction) {
  const Vec3 ab = c[1] - c[0], ac = c[2] - c[0], n = ab.cross(ac);
  const double slope = n.dot(direction);
  if (std::abs(slope) <= 1e-9 * n.norm() || slope == 0) return std::nullopt;
  const Vec3 ao = origin - c[0];
  const Vec3 q = ao.cross(direction);
  const double w1 = -q.dot(ac) / slope, w2 = q.dot(ab) / slope;
  return RayHit{-n.dot(ao) / slope, Vec3(1 - w1 - w2, w1, w2)};
}

// The same number for points with equal coordinates: a mesh may repeat its vertices.
std::vector<std::uint32_t> weld(const std::vector<Vec3>& points) {
  std::vector<std::uint32_t> slots(std::bit_ceil(2 * points.size() + 1), UINT32_MAX);
  std::vector<std::uint32_t> same(points.size());
  const std::size_t mask = slots.size() - 1;
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    std::uint64_t hash = 0;
    for (int k = 0; k < 3; ++k)  // + 0.0 turns -0 into 0
      hash = (std::rotl(hash, 23) ^ std::bit_cast<std::uint64_t>(points[i][k] + 0.0)) *
             0x9E3779B97F4A7C15u;
    std::size_t slot = (hash ^ hash >> 32) & mask;
    while (slots[slot] != UINT32_MAX && points[slots[slot]] != points[i]) slot = (slot + 1) & mask;
    if (slots[slot] == UINT32_MAX) slots[slot] = i;
    same[i] = slots[slot];
  }
  return same;
}

struct DeviceRelease {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
};
struct SceneRelease {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};

}  // namespace

struct TriangleTree::Work {
  Vec3 middle = Vec3::Zero();         // mm, W: the local origin
  double radius = 0;                  // mm: all of the mesh is this near to it
  std::vector<Vec3> points;           // mm, from the local origin
  std::vector<Triangle> triangles;    // with equal points made one
  std::vector<std::uint32_t> first;   // per point, its first entry in `around`; one more at the end
  std::vector<std::uint32_t> around;  // triangles around each point, ascending
  std::unique_ptr<RTCDeviceTy, DeviceRelease> device;
  std::unique_ptr<RTCSceneTy, SceneRelease> scene;

  Corners corners(std::uint32_t t) const {
    return {points[triangles[t][0]], points[triangles[t][1]], points[triangles[t][2]]};
  }
  Vec3 unit_normal(std::uint32_t t) const {
    const Corners c = corners(t);
    return (c[1] - c[0]).cross(c[2] - c[0]).stableNormalized();
  }

  void read(const TriangleMesh& mesh);
  void list_neighbours();
  void build_tree();

  RTCRay ray(const Vec3& origin, const Vec3& direction, double length) const;
  // The ray's part within the mesh's sphere, from and to which distance; false if there is none.
  bool clip(const Vec3& origin, const Vec3& direction, double& from, double& to) const;
  void prefer_first_of_equals(const Vec3& origin, const Vec3& direction, double from, double to,
                              std::uint32_t& triangle, RayHit& hit) const;
  SurfacePoint exactly(const Vec3& start, const Vec3& along, double from, double to,
                       std::uint32_t triangle, double distance, double u, double v) const;
  Vec3 pseudonormal(std::uint32_t triangle, const Vec3& weights) const;
};

void TriangleTree::Work::read(const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) throw Error("the mesh has no triangles");
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i)
    if (!mesh.vertices[i].allFinite())
      throw Error("vertex " + std::to_string(i) + " of the mesh is not finite");
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    for (const std::uint32_t corner : mesh.triangles[t])
      if (corner >= mesh.vertices.size())
        throw Error("triangle " + std::to_string(t) + " of the mesh names vertex " +
                    std::to_string(corner) + ", but there are " +
                    std::to_string(mesh.vertices.size()));
  Vec3 low = Vec3::Constant(kInfinity), high = -low;
  for (const Triangle& t : mesh.triangles)
    for (const std::uint32_t corner : t) {
      low = low.cwiseMin(mesh.vertices[corner].cast<double>());
      high = high.cwiseMax(mesh.vertices[corner].cast<double>());
    }
  middle = (low + high) / 2;
  radius = (high - low).norm() / 2;
  points.resize(mesh.vertices.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    points[i] = mesh.vertices[i].cast<double>() - middle;
  const std::vector<std::uint32_t> same = weld(points);
  triangles = mesh.triangles;
  for (Triangle& t : triangles)
    for (std::uint32_t& corner : t) corner = same[corner];
}

void TriangleTree::Work::list_neighbours() {
  first.assign(points.size() + 1, 0);
  for (const Triangle& t : triangles)
    for (const std::uint32_t corner : t) ++first[corner + 1];
  for (std::size_t i = 0; i < points.size(); ++i) first[i + 1] += first[i];
  around.resize(first.back());
  std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
  for (std::uint32_t t = 0; t < triangles.size(); ++t)
    for (const std::uint32_t corner : triangles[t]) around[next[corner]++] = t;
}

void TriangleTree::Work::build_tree() {
  device.reset(rtcNewDevice("ignore_config_files=1"));
  if (!device) throw Error("Embree can't be started on this computer");
  scene.reset(rtcNewScene(device.get()));
  rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertex = static_cast<float*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), points.size()));
  auto* index = static_cast<std::uint32_t*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, sizeof(Triangle), triangles.size()));
  if (vertex && index) {
    for (const Vec3& p : points)
      for (int k = 0; k < 3; ++k) *vertex++ = static_cast<float>(p[k]);
    for (const Triangle& t : triangles) index = std::copy(t.begin(), t.end(), index);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene.get(), geometry);
  }
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene.get());
  const RTCError fault = rtcGetDeviceError(device.get());
  if (fault == RTC_ERROR_OUT_OF_MEMORY)
    throw Error("there is not enough memory for a tree of " + std::to_string(triangles.size()) +
                " triangles");
  if (fault != RTC_ERROR_NONE)
    throw Error("Embree can't build a tree of the mesh (its error " +
                std::to_string(static_cast<int>(fault)) + ")");
}

TriangleTree::TriangleTree(const TriangleMesh& mesh) : work_(std::make_unique<Work>()) {
  work_->read(mesh);
  work_->list_neighbours();
  work_->build_tree();
}
TriangleTree::~TriangleTree() = default;
TriangleTree::TriangleTree(TriangleTree&&) noexcept = default;

// ---- Rays

RTCRay TriangleTree::Work::ray(const Vec3& origin, const Vec3& direction, double length) const {
  RTCRay ray{};
  ray.org_x = static_cast<float>(origin.x());
  ray.org_y = static_cast<float>(origin.y());
  ray.org_z = static_cast<float>(origin.z());
  ray.dir_x = static_cast<float>(direction.x());
  ray.dir_y = static_cast<float>(direction.y());
  ray.dir_z = static_cast<float>(direction.z());
  ray.tnear = 0;
  ray.tfar = static_cast<float>(length);
  ray.mask = UINT32_MAX;
  return ray;
}

bool TriangleTree::Work::clip(const Vec3& origin, const Vec3& direction, double& from,
                              double& to) const {
  if (from == 0 && to <= radius && origin.squaredNorm() <= radius * radius)
    return true;  // short, and begins within
  const double r = 1.001 * radius + 1e-6;
  const double towards = -origin.dot(direction);
  const double aside2 = (origin + towards * direction).squaredNorm();
  if (!(aside2 <= r * r)) return false;  // a ray with NaN meets nothing
  const double half = std::sqrt(r * r - aside2);
  from = std::max(from, towards - half);
  to = std::min(to, towards + half);
  return from <= to;
}

// A ray that meets an edge meets both its triangles; which one Embree says depends on the order in
// its tree. Of those that share a corner with `triangle` and are met equally early, the first.
void TriangleTree::Work::prefer_first_of_equals(const Vec3& origin, const Vec3& direction,
                                                double from, double to, std::uint32_t& triangle,
                                                RayHit& hit) const {
  const double tie = 1e-9 * (1 + radius);
  std::uint32_t best = UINT32_MAX;
  RayHit best_hit;
  for (const std::uint32_t corner : triangles[triangle])
    for (std::uint32_t k = first[corner]; k < first[corner + 1]; ++k) {
      const std::uint32_t t = around[k];
      const auto met = meet_plane(corners(t), origin, direction);
      if (!met || met->weights.minCoeff() < -kEdgeSlack) continue;
      if (met->distance < from - tie || met->distance > to + tie) continue;
      const bool earlier = best == UINT32_MAX || met->distance < best_hit.distance - tie;
      if (earlier || (met->distance <= best_hit.distance + tie && t < best)) {
        best = t;
        best_hit = *met;
      }
    }
  if (best == UINT32_MAX) return;
  triangle = best;
  hit = best_hit;
}

namespace {

#if TOOTHPREP_EMBREE_MAJOR >= 4
void intersect(RTCScene scene, RTCRayHit& hit) { rtcIntersect1(scene, &hit); }
void occluded(RTCScene scene, RTCRay& ray) { rtcOccluded1(scene, &ray); }
void occluded(const int* valid, RTCScene scene, RTCRay8& rays) {
  rtcOccluded8(valid, scene, &rays);
}
// Of rays side by side.
void intersect(const int* valid, RTCScene scene, RTCRayHit8& hits) {
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  rtcIntersect8(valid, scene, &hits, &arguments);
}
#else
void intersect(RTCScene scene, RTCRayHit& hit) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(scene, &context, &hit);
}
void occluded(RTCScene scene, RTCRay& ray) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(scene, &context, &ray);
}
void occluded(const int* valid, RTCScene scene, RTCRay8& rays) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded8(valid, scene, &context, &rays);
}
void intersect(const int* valid, RTCScene scene, RTCRayHit8& hits) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect8(valid, scene, &context, &hits);
}
#endif

void put(const RTCRay& ray, std::size_t i, RTCRay8& rays) {
  rays.org_x[i] = ray.org_x, rays.org_y[i] = ray.org_y, rays.org_z[i] = ray.org_z;
  rays.dir_x[i] = ray.dir_x, rays.dir_y[i] = ray.dir_y, rays.dir_z[i] = ray.dir_z;
  rays.tfar[i] = ray.tfar;
  rays.mask[i] = ray.mask;
}

}  // namespace

// Where a ray from `start`, which is `from` along it, meets what Embree found.
SurfacePoint TriangleTree::Work::exactly(const Vec3& start, const Vec3& along, double from,
                                         double to, std::uint32_t triangle, double distance,
                                         double u, double v) const {
  RayHit hit{distance, Vec3(1 - u - v, u, v)};
  const auto exact = meet_plane(corners(triangle), start, along);
  // Where the ray grazes the triangle, the plane says less than Embree does.
  if (exact && std::abs(exact->distance - hit.distance) < 1e-4 * (1 + radius)) hit = *exact;
  if (hit.weights.minCoeff() < kEdgeZone)
    prefer_first_of_equals(start, along, 0, to - from, triangle, hit);
  hit.weights = hit.weights.cwiseMax(0.0);
  hit.weights /= hit.weights.sum();
  return SurfacePoint{middle + weighted(corners(triangle), hit.weights),
                      std::max(0.0, from + hit.distance), triangle, hit.weights};
}

std::optional<SurfacePoint> TriangleTree::first_hit(const Vec3& origin, const Vec3& direction,
                                                    double nearest, double furthest) const {
  const Vec3 along = direction.stableNormalized(), local = origin - work_->middle;
  double from = nearest, to = furthest;
  if (!work_->clip(local, along, from, to)) return std::nullopt;
  // The ray starts where it enters the mesh's sphere, so that single precision is enough for it.
  const Vec3 start = local + from * along;
  RTCRayHit found{};
  found.ray = work_->ray(start, along, to - from);
  found.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  found.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  intersect(work_->scene.get(), found);
  if (found.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  return work_->exactly(start, along, from, to, found.hit.primID, found.ray.tfar, found.hit.u,
                        found.hit.v);
}

std::array<std::optional<SurfacePoint>, TriangleTree::kTogether> TriangleTree::first_hits(
    std::span<const TreeRay> rays) const {
  RTCRayHit8 together{};
  alignas(32) std::array<int, kTogether> valid{};  // -1: Embree's true
  struct Start {
    Vec3 at, along;
    double from, to;
  };
  std::array<Start, kTogether> starts;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const TreeRay& ray = rays[i];
    const Vec3 along = ray.direction.stableNormalized(), local = ray.origin - work_->middle;
    double from = ray.nearest, to = ray.furthest;
    together.hit.geomID[i] = together.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    if (!work_->clip(local, along, from, to)) continue;
    starts[i] = {local + from * along, along, from, to};
    put(work_->ray(starts[i].at, along, to - from), i, together.ray);
    valid[i] = -1;
  }
  intersect(valid.data(), work_->scene.get(), together);
  std::array<std::optional<SurfacePoint>, kTogether> hits;
  for (std::size_t i = 0; i < rays.size(); ++i)
    if (valid[i] != 0 && together.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID)
      hits[i] = work_->exactly(starts[i].at, starts[i].along, starts[i].from, starts[i].to,
                               together.hit.primID[i], together.ray.tfar[i], together.hit.u[i],
                               together.hit.v[i]);
  return hits;
}

bool TriangleTree::hits(const Vec3& origin, const Vec3& direction, double nearest,
                        double furthest) const {
  const Vec3 along = direction.stableNormalized(), local = origin - work_->middle;
  double from = nearest, to = furthest;
  if (!work_->clip(local, along, from, to)) return false;
  RTCRay ray = work_->ray(local + from * along, along, to - from);
  occluded(work_->scene.get(), ray);
  return ray.tfar < 0;  // Embree says so by -infinity
}

std::uint32_t TriangleTree::which_hit(std::span<const TreeRay> rays) const {
  RTCRay8 together{};
  alignas(32) std::array<int, kTogether> valid{};  // -1: Embree's true
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const TreeRay& ray = rays[i];
    const Vec3 along = ray.direction.stableNormalized(), local = ray.origin - work_->middle;
    double from = ray.nearest, to = ray.furthest;
    if (!work_->clip(local, along, from, to)) continue;
    put(work_->ray(local + from * along, along, to - from), i, together);
    valid[i] = -1;
  }
  occluded(valid.data(), work_->scene.get(), together);
  std::uint32_t met = 0;
  for (std::size_t i = 0; i < rays.size(); ++i)
    if (valid[i] != 0 && together.tfar[i] < 0) met |= 1U << i;
  return met;
}

// ---- Nearest points

namespace {

struct NearestQuery {
  const std::vector<Vec3>& points;
  const std::vector<Triangle>& triangles;
  Vec3 x;       // mm, from the local origin
  float slack;  // mm: what single precision may have done to x and to the boxes
  double distance2 = kInfinity;
  std::uint32_t triangle = UINT32_MAX;
  Vec3 weights = Vec3::UnitX();
};

bool try_triangle(RTCPointQueryFunctionArguments* arguments) {
  auto& q = *static_cast<NearestQuery*>(arguments->userPtr);
  const Triangle& t = q.triangles[arguments->primID];
  const Corners c = {q.points[t[0]], q.points[t[1]], q.points[t[2]]};
  const Vec3 weights = nearest_weights(c, q.x);
  const double distance2 = (weighted(c, weights) - q.x).squaredNorm();
  // Of equals the first, whatever the order in the tree.
  if (distance2 > q.distance2 || (distance2 == q.distance2 && arguments->primID > q.triangle))
    return false;
  q.distance2 = distance2;
  q.triangle = arguments->primID;
  q.weights = weights;
  const float radius = static_cast<float>(std::sqrt(distance2)) * 1.000001f + q.slack;
  if (radius >= arguments->query->radius) return false;
  arguments->query->radius = radius;
  return true;
}

}  // namespace

SurfacePoint TriangleTree::nearest(const Vec3& x) const {
  const Vec3 local = x - work_->middle;
  if (!local.allFinite()) throw Error("the nearest point of a place that is not finite");
  NearestQuery q{work_->points, work_->triangles, local,
                 static_cast<float>(1e-6 * (work_->radius + local.norm()) + 1e-9)};
  RTCPointQuery query{};
  query.x = static_cast<float>(local.x());
  query.y = static_cast<float>(local.y());
  query.z = static_cast<float>(local.z());
  query.radius = std::numeric_limits<float>::infinity();
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(work_->scene.get(), &query, &context, try_triangle, &q);
  if (q.triangle == UINT32_MAX)
    throw Error("a place too far away to find the mesh's nearest point");
  const Vec3 at = weighted(work_->corners(q.triangle), q.weights);
  return {work_->middle + at, std::sqrt(q.distance2), q.triangle, q.weights};
}

// Sum of the normals of the triangles that share the feature (face, edge or corner) on which the
// point lies; around a corner each counts by its angle there.
Vec3 TriangleTree::Work::pseudonormal(std::uint32_t triangle, const Vec3& weights) const {
  const Triangle& t = triangles[triangle];
  const int corners_used = static_cast<int>((weights.array() > 0).count());
  if (corners_used == 3) return unit_normal(triangle);
  int k = 0;
  weights.maxCoeff(&k);
  const std::uint32_t here = t[k];
  Vec3 sum = Vec3::Zero();
  if (corners_used == 2) {
    const std::uint32_t there = weights[(k + 1) % 3] > 0 ? t[(k + 1) % 3] : t[(k + 2) % 3];
    for (std::uint32_t i = first[here]; i < first[here + 1]; ++i) {
      const Triangle& other = triangles[around[i]];
      if (std::find(other.begin(), other.end(), there) != other.end())
        sum += unit_normal(around[i]);
    }
    return sum;
  }
  for (std::uint32_t i = first[here]; i < first[here + 1]; ++i) {
    const Triangle& other = triangles[around[i]];
    const auto at = std::find(other.begin(), other.end(), here) - other.begin();
    const Vec3 a = points[other[(at + 1) % 3]] - points[here];
    const Vec3 b = points[other[(at + 2) % 3]] - points[here];
    sum += std::atan2(a.cross(b).norm(), a.dot(b)) * unit_normal(around[i]);
  }
  return sum;
}

double TriangleTree::signed_distance(const Vec3& x) const {
  const SurfacePoint p = nearest(x);
  const Vec3 outward = work_->pseudonormal(p.triangle, p.weights);
  return outward.dot(x - p.point) < 0 ? -p.distance : p.distance;
}

Vec3 TriangleTree::normal(std::uint32_t triangle) const { return work_->unit_normal(triangle); }

}  // namespace toothprep
