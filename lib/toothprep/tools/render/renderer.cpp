#include "toothprep/tools/render/renderer.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/mesh/triangle_tree.h"
#include "toothprep/tools/render/mesh_normals.h"

namespace toothprep {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kTile = 128;  // pixels each way that are looked at in one go
constexpr int kField = 32;  // of these, pixels each way that share rays; even, divides kTile
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// A number in [0, 1) for each pixel, of which near ones differ much (J. Jimenez, SIGGRAPH 2014).
double pixel_noise(int x, int y) {
  const double v = 52.9829189 * std::fmod(0.06711056 * x + 0.00583715 * y, 1.0);
  return v - std::floor(v);
}

// The digits of i mirrored behind the point: 0.1, 0.01, 0.11, ... (van der Corput).
double radical_inverse(int i, int base) {
  double value = 0, place = 1.0 / base;
  for (; i > 0; i /= base, place /= base) value += place * (i % base);
  return value;
}

double fraction(double v) { return v - std::floor(v); }

struct Seen {
  double depth = kInfinity;    // mm from the camera's plane
  Vec3 point = Vec3::Zero();   // mm, W
  Vec3 face = Vec3::Zero();    // the triangle's normal, towards the camera
  Vec3 normal = Vec3::Zero();  // for shading, towards the camera
  bool on_cut = false;
  Tissue tissue = Tissue::kAir;
  float deviation = kNan;  // mm
  Colour colour = Colour::Zero();
  bool figure = false;  // the colour is a figure to be read: little shade
  // Of the lights, what the surface turns towards them, and the key light's gloss.
  float upward = 0, to_key = 0, to_fill = 0, gloss = 0;
};

// Per corner of each triangle that of the level set of the triangle's side at the vertex, so that a
// margin stays sharp; the mesh's where two surfaces stand too close for one.
std::vector<Eigen::Vector3f> level_normals(const RenderPart& part) {
  const TriangleMesh& mesh = part.mesh;
  const std::size_t count = mesh.triangles.size();
  std::vector<Side> sides(count);
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t t) {
    Vec3 sum = Vec3::Zero();
    for (const std::uint32_t corner : mesh.triangles[t])
      sum += mesh.vertices[corner].cast<double>();
    sides[t] = side_at(*part.tooth, sum / 3);
  });
  // A vertex has one on each side of which it has triangles: whether, and then which.
  constexpr std::size_t kSides = 3;
  const auto place = [](std::uint32_t vertex, Side side) {
    return kSides * vertex + static_cast<std::size_t>(side);
  };
  std::vector<char> used(kSides * mesh.vertices.size(), 0);
  for (std::size_t t = 0; t < count; ++t)
    for (const std::uint32_t corner : mesh.triangles[t]) used[place(corner, sides[t])] = 1;
  std::vector<Eigen::Vector3f> known(used.size());
  std::atomic<bool> all{true};
  tbb::parallel_for(std::size_t{0}, used.size(), [&](std::size_t i) {
    if (!used[i]) return;
    const Vec3 at = mesh.vertices[i / kSides].cast<double>();
    known[i] = level_normal(*part.tooth, at, static_cast<Side>(i % kSides)).cast<float>();
    if (known[i].squaredNorm() == 0) all = false;
  });
  std::vector<Eigen::Vector3f> normals(3 * count);
  for (std::size_t t = 0; t < count; ++t)
    for (std::size_t c = 0; c < 3; ++c)
      normals[3 * t + c] = known[place(mesh.triangles[t][c], sides[t])];
  if (all) return normals;
  const std::vector<Eigen::Vector3f> of_mesh = corner_normals(mesh, part.smoothing);
  for (std::size_t i = 0; i < normals.size(); ++i)
    if (normals[i].squaredNorm() == 0) normals[i] = of_mesh[i];
  return normals;
}

float fiftieth_power(double x) {
  const double second = x * x, fourth = second * second, eighth = fourth * fourth;
  const double sixteenth = eighth * eighth;
  return static_cast<float>(sixteenth * sixteenth * sixteenth * second);
}

int rounded_up(int value, int step) { return (value + step - 1) / step * step; }

// Whether two places are of one surface, so that what lies between them may be left out: nothing
// at both, or the same tissue, no edge, and no step in depth.
bool of_one_surface(const Seen& a, const Seen& b, double largest_step) {
  if (a.depth == kInfinity || b.depth == kInfinity) return a.depth == b.depth;
  return a.on_cut == b.on_cut && a.tissue == b.tissue && a.normal.dot(b.normal) > 0.99 &&
         std::abs(a.depth - b.depth) < largest_step;
}

// What is seen at the centres of some pixels and at their corners and some corners around, row by
// row; and whether the key light meets each corner, by one ray.
struct Tile {
  static constexpr int kAround = 2;
  int left, top, width, height;  // pixels
  std::vector<Seen> centres, corners;
  static constexpr std::uint8_t kDark = 1, kLit = 2;
  std::vector<std::uint8_t> light;  // of each corner one of these, or 0 where nothing is seen

  const Seen& centre(int x, int y) const {
    return centres[static_cast<std::size_t>(y * width + x)];
  }
  // That at the upper left of pixel x, y.
  std::size_t corner(int x, int y) const {
    return static_cast<std::size_t>((y + kAround) * (width + 2 * kAround + 1) + x + kAround);
  }
  std::array<std::size_t, 4> corners_of(int x, int y) const {
    return {corner(x, y), corner(x + 1, y), corner(x, y + 1), corner(x + 1, y + 1)};
  }
  // Whether a pixel's centre and corners are of one surface, so that they stand for all samples.
  bool plain(int x, int y, double largest_step) const {
    for (const std::size_t c : corners_of(x, y))
      if (!of_one_surface(corners[c], centre(x, y), largest_step)) return false;
    return true;
  }
  // Whether the corners in and around a pixel are in the key light; nothing where they disagree.
  std::optional<bool> all_lit(int x, int y) const {
    constexpr std::size_t kCorners = 2 * kAround + 2;  // each way
    unsigned all = 0;
    for (int v = y - kAround; v <= y + kAround + 1; ++v) {
      const std::uint8_t* row = light.data() + corner(x - kAround, v);
      for (std::size_t u = 0; u < kCorners; ++u) all |= row[u];
    }
    if (all == (kDark | kLit)) return std::nullopt;
    return all == kLit;
  }
};

// Up to 2 x 2 pixels of one surface.
struct Block {
  std::vector<std::array<int, 2>> pixels;  // of its tile; none: it is drawn
  const Seen* place = nullptr;             // of the first
  std::array<float, 4> open{};             // shares of the quarters of the sky
};

struct SkyLight {
  Colour bounced = Colour::Zero();  // also from walls of the place's colour
  float open = 0;                   // share of the sky
};

}  // namespace

struct Renderer::Part {
  RenderPart part;
  TriangleTree tree;
  std::vector<Eigen::Vector3f> normals;  // three per triangle
  std::vector<Vec3> faces;               // of each triangle its own

  explicit Part(RenderPart given)
      : part(std::move(given)),
        tree(part.mesh),
        normals(part.tooth ? level_normals(part) : corner_normals(part.mesh, part.smoothing)),
        faces(part.mesh.triangles.size()) {
    tbb::parallel_for(std::size_t{0}, faces.size(), [&](std::size_t t) {
      faces[t] = tree.normal(static_cast<std::uint32_t>(t));
    });
    const std::size_t vertices = part.mesh.vertices.size();
    if (!part.mesh.tissue.empty() && part.mesh.tissue.size() != vertices)
      throw Error("the mesh has " + std::to_string(vertices) + " vertices, but " +
                  std::to_string(part.mesh.tissue.size()) + " tissues");
    if (!part.mesh.triangle_tissue.empty() &&
        part.mesh.triangle_tissue.size() != part.mesh.triangles.size())
      throw Error("the mesh has " + std::to_string(part.mesh.triangles.size()) +
                  " triangles, but " + std::to_string(part.mesh.triangle_tissue.size()) +
                  " tissues of triangles");
    if (!part.deviation.empty() && part.deviation.size() != vertices)
      throw Error("the mesh has " + std::to_string(vertices) + " vertices, but " +
                  std::to_string(part.deviation.size()) + " deviations");
  }

  bool solid_at(const Vec3& x, const Vec3& forward) const {
    if (part.tooth) return inside(*part.tooth, x);
    const auto out = tree.first_hit(x, forward);
    return out && faces[out->triangle].dot(forward) > 0;
  }

  Vec3 shading_normal(const SurfacePoint& at) const {
    Vec3 n = Vec3::Zero();
    for (int k = 0; k < 3; ++k) n += at.weights[k] * normals[3 * at.triangle + k].cast<double>();
    return n.norm() > 1e-6 ? n.normalized() : faces[at.triangle];
  }

  void describe_surface(const SurfacePoint& at, double range, Seen& seen) const {
    const auto& corner = part.mesh.triangles[at.triangle];
    int nearest = 0;
    at.weights.maxCoeff(&nearest);
    const bool by_triangle = !part.mesh.triangle_tissue.empty();
    if (by_triangle)
      seen.tissue = static_cast<Tissue>(
          std::min<std::uint8_t>(part.mesh.triangle_tissue[at.triangle], kTissueCount));
    else if (part.tooth)
      seen.tissue = tissue_in(*part.tooth, at.point);
    else if (!part.mesh.tissue.empty())
      seen.tissue = static_cast<Tissue>(
          std::min<std::uint8_t>(part.mesh.tissue[corner[nearest]], kTissueCount));
    if (!part.deviation.empty()) {
      double sum = 0;
      for (int k = 0; k < 3; ++k)
        if (at.weights[k] > 0) sum += at.weights[k] * part.deviation[corner[k]];
      seen.deviation = static_cast<float>(sum);
    }
    switch (part.colour) {
      case ColourBy::kDeviation:
        seen.colour = diverging_colour(static_cast<float>(seen.deviation / range));
        seen.figure = true;
        return;
      case ColourBy::kPlain:
        seen.colour = tissue_colour(Tissue::kAir);
        return;
      case ColourBy::kTissue:
        break;
    }
    seen.colour = tissue_colour(seen.tissue);
    if (by_triangle || part.tooth || part.mesh.tissue.empty()) return;
    seen.colour = Colour::Zero();
    for (int k = 0; k < 3; ++k)
      seen.colour += static_cast<float>(at.weights[k]) *
                     tissue_colour(static_cast<Tissue>(
                         std::min<std::uint8_t>(part.mesh.tissue[corner[k]], kTissueCount)));
  }

  void describe_cut(const Vec3& at, Seen& seen) const {
    if (part.tooth) seen.tissue = tissue_in(*part.tooth, at);
    seen.colour = part.colour == ColourBy::kTissue && part.tooth ? tissue_colour(seen.tissue)
                                                                 : Colour(0.50f, 0.47f, 0.43f);
  }
};

// One picture: what all its pixels share.
struct Renderer::Pass {
  // A direction about a third axis, and a number in [0, 1) for its length.
  struct Direction {
    double across, aside, up;  // along the axes
    double third;
  };
  static Direction direction(double across, double up, int i) {
    const double angle = 2 * units::kPi * radical_inverse(i, 2);
    return {across * std::cos(angle), across * std::sin(angle), up, radical_inverse(i, 3)};
  }

  // To places in the key light, a disc of 7° around it.
  static std::vector<Direction> lamp_places(int total) {
    std::vector<Direction> places;
    for (int i = 0; i < total; ++i) {
      const double r = 0.12 * std::sqrt((i + 0.5) / total), up = 1 / std::sqrt(1 + r * r);
      places.push_back(direction(r * up, up, i));
    }
    return places;
  }

  static std::vector<Direction> sky_rays(int total) {
    std::vector<Direction> rays;
    for (int i = 0; i < total; ++i) {
      const double r2 = (i + 0.5) / total;
      rays.push_back(direction(std::sqrt(r2), std::sqrt(1 - r2), i));
    }
    return rays;
  }

  struct Turn {  // of directions
    explicit Turn(double of_all)
        : share(of_all),
          c(std::cos(2 * units::kPi * of_all)),
          s(std::sin(2 * units::kPi * of_all)) {}
    double share, c, s;
  };

  struct Axes {
    Vec3 u, v, w;
    // The first two turned about the third.
    Axes turned(const Turn& t) const { return {t.c * u + t.s * v, t.c * v - t.s * u, w}; }
    Vec3 along(const Direction& d) const { return d.across * u + d.aside * v + d.up * w; }
  };

  const std::vector<Part>& parts;
  const Camera& camera;
  const RenderOptions& options;
  double reach;  // of the ambient light, mm
  double lift;   // mm: rays start this far above the surface, so as not to meet it
  std::optional<CutPlane> cut;
  Axes key;  // the third points to the light
  Vec3 fill, sky;
  Vec3 half;                                       // between the key light and the eye
  std::vector<Direction> plain_rays, sample_rays;  // for sky_shares(), for draw_samples()
  std::vector<Direction> corner_lamp, plain_lamp, sample_lamp;  // for light_corners(), draw_plain()
  bool any_ghost;

  // The part of a ray behind the cut; `entry`: it begins on the cut, seen from the removed side.
  bool kept(const Vec3& origin, const Vec3& along, double& from, double& to, bool& entry) const {
    entry = false;
    if (!cut) return true;
    const double height = (origin - cut->point).dot(cut->normal);
    const double slope = along.dot(cut->normal);
    if (std::abs(slope) < 1e-12) return height <= 0;
    const double meets = -height / slope;
    if (slope > 0) {
      to = std::min(to, meets);
    } else if (meets > from) {
      from = meets;
      entry = true;
    }
    return from < to;
  }

  bool look(const Vec3& origin, bool ghosts, Seen& seen) const {
    double from = 0, to = kInfinity;
    bool entry = false;
    if (!kept(origin, camera.forward, from, to, entry)) return false;
    const Part* part = nullptr;
    SurfacePoint at;
    double nearest = std::min(to, 1e6);
    for (const Part& p : parts) {
      if (p.part.ghost != ghosts) continue;
      if (entry && !ghosts) {
        const Vec3 x = origin + from * camera.forward;
        if (p.solid_at(x, camera.forward)) {
          seen.depth = from;
          seen.point = x;
          seen.face = seen.normal = cut->normal;
          seen.on_cut = true;
          p.describe_cut(x, seen);
          face_lights(seen);
          return true;
        }
      }
      const auto hit = p.tree.first_hit(origin, camera.forward, from, nearest);
      if (!hit) continue;
      nearest = hit->distance;
      at = *hit;
      part = &p;
    }
    if (!part) return false;
    describe(*part, at, seen);
    return true;
  }

  // What is seen at places a pixel apart, from x, y on.
  void look_along_row(double x, double y, int count, std::vector<Seen>& row) const {
    const auto drawn = [](const Part& p) { return !p.part.ghost; };
    const auto only = std::find_if(parts.begin(), parts.end(), drawn);
    const bool together = !cut && std::count_if(parts.begin(), parts.end(), drawn) == 1;
    constexpr int kTogether = TriangleTree::kTogether;
    for (int first = 0; first < count; first += kTogether) {
      std::array<TreeRay, kTogether> rays;
      const int n = std::min(kTogether, count - first);
      for (int i = 0; i < n; ++i)
        rays[i] = {camera.place(x + first + i, y), camera.forward, 0, 1e6};
      std::array<std::optional<SurfacePoint>, kTogether> hits;
      if (together) hits = only->tree.first_hits({rays.data(), static_cast<std::size_t>(n)});
      for (int i = 0; i < n; ++i) {
        Seen& seen = row.emplace_back();
        if (!together)
          look(rays[i].origin, false, seen);
        else if (hits[i])
          describe(*only, *hits[i], seen);
      }
    }
  }

  void describe(const Part& part, const SurfacePoint& at, Seen& seen) const {
    seen.depth = at.distance;
    seen.point = at.point;
    seen.face = part.faces[at.triangle];
    seen.normal = part.shading_normal(at);
    if (seen.face.dot(camera.forward) > 0) {  // the inside of an open shell
      seen.face = -seen.face;
      seen.normal = -seen.normal;
    }
    part.describe_surface(at, options.range, seen);
    // Smoothed normals may lean away from the eye at an outline.
    const double away = seen.normal.dot(camera.forward);
    if (away > -0.01) seen.normal = (seen.normal - (away + 0.01) * camera.forward).normalized();
    face_lights(seen);
  }

  // Once for each place, which several pixels share.
  void face_lights(Seen& seen) const {
    const auto facing = [&](const Vec3& light) {
      return static_cast<float>(std::max(0.0, seen.normal.dot(light)));
    };
    seen.upward = static_cast<float>(seen.normal.dot(sky));
    seen.to_key = facing(key.w);
    seen.to_fill = facing(fill);
    seen.gloss = seen.on_cut ? 0.f : fiftieth_power(facing(half));
  }

  // Of rays, those that meet a part of what is kept: bit i that of rays[i].
  std::uint32_t blocked(std::span<const TreeRay> rays) const {
    std::array<TreeRay, TriangleTree::kTogether> left;
    std::array<std::uint32_t, TriangleTree::kTogether> bit;
    std::size_t count = 0;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      left[count] = rays[i];
      bit[count] = 1U << i;
      bool entry = false;
      count +=
          kept(rays[i].origin, rays[i].direction, left[count].nearest, left[count].furthest, entry);
    }
    std::uint32_t met = 0;
    for (const Part& p : parts) {
      if (p.part.ghost || count == 0) continue;
      const std::uint32_t now = p.tree.which_hit({left.data(), count});
      for (std::size_t i = 0; i < count; ++i) met |= (now >> i & 1) * bit[i];
    }
    return met;
  }

  struct Sky {
    int rays = 0, open = 0;  // those that meet nothing
    float share() const {
      return rays > 0 ? static_cast<float>(open) / static_cast<float>(rays) : 1.f;
    }
  };

  // Rays, met as many together as the tree takes; counts in groups those that meet nothing.
  class Rays {
   public:
    explicit Rays(const Pass& pass) : pass_(pass) {}
    std::array<Sky, 4> groups;

    void add(const TreeRay& ray, std::size_t group) {
      rays_[count_] = ray;
      group_[count_] = group;
      if (++count_ == rays_.size()) shoot();
    }
    void add_open(std::size_t group) { ++groups[group].rays, ++groups[group].open; }
    void add_blocked(std::size_t group) { ++groups[group].rays; }
    void shoot() {  // what was added and waits
      const std::uint32_t met = pass_.blocked({rays_.data(), count_});
      for (std::size_t i = 0; i < count_; ++i)
        (met >> i & 1) != 0 ? add_blocked(group_[i]) : add_open(group_[i]);
      count_ = 0;
    }

   private:
    const Pass& pass_;
    std::array<TreeRay, TriangleTree::kTogether> rays_;
    std::array<std::size_t, TriangleTree::kTogether> group_{};
    std::size_t count_ = 0;
  };

  // Of the directions over the hemisphere the rays first, first + step, ... to see which of them
  // meet the sky. Directions are cosine-distributed (Hammersley's points), lengths spread so that an
  // obstacle at distance t counts 1 - (t / reach)^2.
  void add_sky(const Seen& seen, int first, int step, const std::vector<Direction>& directions,
               const Turn& turn, std::size_t group, Rays& rays) const {
    const Vec3 u = seen.normal.unitOrthogonal();
    const Axes axes = Axes{u, seen.normal.cross(u), seen.normal}.turned(turn);
    const Vec3 start = seen.point + lift * seen.face;
    for (std::size_t i = first; i < directions.size(); i += step) {
      const double length = reach * std::sqrt(fraction(directions[i].third + turn.share));
      const Vec3 along = axes.along(directions[i]);
      if (along.dot(seen.face) <= 0)
        rays.add_open(group);
      else
        rays.add({start, along, 0, length}, group);
    }
  }

  // Towards a place in the key light; nothing if the surface looks away from it.
  std::optional<TreeRay> key_ray(const Seen& seen, const Direction& place,
                                 const Axes& turned_key) const {
    const Vec3 along = turned_key.along(place);
    if (along.dot(seen.face) <= 0) return std::nullopt;
    return TreeRay{seen.point + lift * seen.face, along, 0, 1e6};
  }

  void add_key(const Seen& seen, const Direction& place, const Axes& turned_key, std::size_t group,
               Rays& rays) const {
    if (const auto ray = key_ray(seen, place, turned_key))
      rays.add(*ray, group);
    else
      rays.add_blocked(group);
  }

  // `shares`: how much of the sky is open to a place, of equal parts of the sky.
  static SkyLight sky_light(const Colour& colour, std::span<const float> shares) {
    const Eigen::Array4f own(colour[0], colour[1], colour[2], 0);  // as wide as vectors are
    Eigen::Array4f bounced = Eigen::Array4f::Zero();
    SkyLight light;
    for (const float open : shares) {
      // Light thrown to and fro between walls of this colour: a geometric series.
      if (open == 1)
        bounced += 1;
      else
        bounced += open / (1 - 0.8f * own * (1 - open));
      light.open += open;
    }
    light.bounced = bounced.head<3>() / static_cast<float>(shares.size());
    light.open /= static_cast<float>(shares.size());
    return light;
  }

  Colour shade(const Seen& seen, const SkyLight& from_sky, float lit) const {
    Colour light = from_sky.bounced * (0.40f + 0.08f * seen.upward);
    light += 0.66f * lit * seen.to_key;
    light += (0.3f + 0.7f * from_sky.open) * 0.16f * seen.to_fill;
    if (seen.figure) light = 0.5f + 0.5f * light;
    return seen.colour * light + (seen.figure ? 0.f : 0.07f * lit * seen.gloss);
  }

  // A tint before what lies behind, denser where the glass is seen at a slant: colour, alpha.
  void add_ghost(const Vec3& origin, double depth, Colour& colour, float& alpha) const {
    Seen glass;
    if (!look(origin, true, glass) || glass.depth > depth - lift) return;
    const float slant = 1 - static_cast<float>(-glass.normal.dot(camera.forward));
    const float density = 0.20f + 0.60f * slant * slant * slant;
    const Colour tint(0.30f, 0.48f, 0.62f);
    colour = density * tint + (1 - density) * colour;
    alpha = density + (1 - density) * alpha;
  }

  Tile look_at_tile(int left, int top, Image& image) const {
    Tile tile{
        left, top, std::min(kTile, camera.width - left), std::min(kTile, camera.height - top), {},
        {},   {}};
    tile.centres.reserve(static_cast<std::size_t>(tile.width * tile.height));
    for (int y = top; y < top + tile.height; ++y)
      look_along_row(left + 0.5, y + 0.5, tile.width, tile.centres);
    for (int y = top; y < top + tile.height; ++y)
      for (int x = left; x < left + tile.width; ++x) {
        const Seen& seen = tile.centre(x - left, y - top);
        if (seen.depth == kInfinity) continue;
        const std::size_t p = image.pixel(x, y);
        image.depth[p] = static_cast<float>(seen.depth);
        for (int k = 0; k < 3; ++k) image.normal[3 * p + k] = static_cast<float>(seen.normal[k]);
        image.tissue[p] = static_cast<float>(seen.tissue);
        image.deviation[p] = seen.deviation;
      }
    if (any_ghost) return tile;
    tile.corners.reserve(tile.corner(-Tile::kAround, tile.height + Tile::kAround + 1));
    for (int y = top - Tile::kAround; y <= top + tile.height + Tile::kAround; ++y)
      look_along_row(left - Tile::kAround, y, tile.width + 2 * Tile::kAround + 1, tile.corners);
    light_corners(tile);
    return tile;
  }

  void light_corners(Tile& tile) const {
    tile.light.assign(tile.corners.size(), 0);
    std::array<TreeRay, TriangleTree::kTogether> rays;
    std::array<std::size_t, TriangleTree::kTogether> corner{};
    std::size_t count = 0, at = 0;
    const auto shoot = [&] {
      const std::uint32_t met = blocked({rays.data(), count});
      for (std::size_t i = 0; i < count; ++i)
        if ((met >> i & 1) == 0) tile.light[corner[i]] = Tile::kLit;
      count = 0;
    };
    for (int y = tile.top - Tile::kAround; y <= tile.top + tile.height + Tile::kAround; ++y)
      for (int x = tile.left - Tile::kAround; x <= tile.left + tile.width + Tile::kAround;
           ++x, ++at) {
        const Seen& seen = tile.corners[at];
        if (seen.depth == kInfinity) continue;
        tile.light[at] = Tile::kDark;
        // Neighbouring corners take the four parts of the lamp.
        const auto ray = key_ray(seen, corner_lamp[static_cast<std::size_t>((x & 1) + 2 * (y & 1))],
                                 key.turned(Turn(pixel_noise(x, y))));
        if (!ray) continue;
        rays[count] = *ray;
        corner[count] = at;
        if (++count == rays.size()) shoot();
      }
    shoot();
  }

  void draw_tile(int left, int top, Image& image) const {
    const Tile tile = look_at_tile(left, top, image);
    for (int y = 0; y < tile.height; y += kField)
      for (int x = 0; x < tile.width; x += kField) draw_field(tile, x, y, image);
  }

  void draw_field(const Tile& tile, int left, int top, Image& image) const {
    const int across = (std::min(kField, tile.width - left) + 1) / 2;
    const int down = (std::min(kField, tile.height - top) + 1) / 2;
    std::vector<Block> blocks;
    for (int y = 0; y < down; ++y)
      for (int x = 0; x < across; ++x)
        blocks.push_back(look_at_block(tile, left + 2 * x, top + 2 * y, image));
    std::vector<float> shares;
    for (int y = 0; y < down; ++y)
      for (int x = 0; x < across; ++x) {
        const Block& block = blocks[static_cast<std::size_t>(y * across + x)];
        if (block.pixels.empty()) continue;
        shares.clear();
        for (int v = std::max(y - 1, 0); v <= std::min(y + 1, down - 1); ++v)
          for (int u = std::max(x - 1, 0); u <= std::min(x + 1, across - 1); ++u) {
            const Block& near = blocks[static_cast<std::size_t>(v * across + u)];
            if (!near.pixels.empty() &&
                of_one_surface(*near.place, *block.place, 2 * largest_step()))
              shares.insert(shares.end(), near.open.begin(), near.open.end());
          }
        // Most pixels of a block have one colour.
        const Colour& colour = block.place->colour;
        const SkyLight from_sky = sky_light(colour, shares);
        for (const auto& [px, py] : block.pixels) {
          const Colour& own = tile.centre(px, py).colour;
          draw_plain(tile, px, py, (own == colour).all() ? from_sky : sky_light(own, shares),
                     image);
        }
      }
  }

  // Between places that are a pixel apart, mm.
  double largest_step() const { return 3 * camera.mm_per_pixel; }

  // Draws those of up to 2 x 2 pixels that don't show one surface. The others share their rays to
  // the sky if they show the same one, and are drawn here if not.
  Block look_at_block(const Tile& tile, int left, int top, Image& image) const {
    Block block;
    std::vector<const Seen*> places;
    bool together = true;
    for (int y = top; y < std::min(top + 2, tile.height); ++y)
      for (int x = left; x < std::min(left + 2, tile.width); ++x) {
        if (any_ghost || !tile.plain(x, y, largest_step())) {
          draw_samples(tile.left + x, tile.top + y, image);
        } else if (tile.centre(x, y).depth < kInfinity) {
          places.push_back(&tile.centre(x, y));
          block.pixels.push_back({x, y});
          together = together && of_one_surface(*places.front(), *places.back(), largest_step());
        }
      }
    if (places.empty()) return block;
    const double turn = pixel_noise(tile.left + left, tile.top + top);
    if (together) {
      block.place = places.front();
      block.open = sky_shares(places, turn);
      return block;
    }
    for (std::size_t i = 0; i < places.size(); ++i)
      draw_plain(tile, block.pixels[i][0], block.pixels[i][1],
                 sky_light(places[i]->colour, sky_shares({places[i]}, turn)), image);
    return {};
  }

  // Of the quarters of the sky. A third of the rays first, and the others if one was blocked.
  std::array<float, 4> sky_shares(const std::vector<const Seen*>& places, double turn) const {
    Rays rays(*this);
    const Turn turned(turn);
    const auto add = [&](std::size_t part) {
      add_sky(*places[part % places.size()], static_cast<int>(part), 12, plain_rays, turned,
              part % 4, rays);
    };
    const std::array<Sky, 4>& above = rays.groups;
    for (std::size_t part = 0; part < 4; ++part) add(part);
    rays.shoot();
    if (std::any_of(above.begin(), above.end(), [](const Sky& s) { return s.open < s.rays; })) {
      for (std::size_t part = 4; part < 12; ++part) add(part);
      rays.shoot();
    }
    return {above[0].share(), above[1].share(), above[2].share(), above[3].share()};
  }

  // The mean of the pixel by Simpson's rule. The key light is tried by more rays where the
  // corners' disagree.
  void draw_plain(const Tile& tile, int x, int y, const SkyLight& from_sky, Image& image) const {
    const Seen& centre = tile.centre(x, y);
    const auto corners = tile.corners_of(x, y);
    const std::optional<bool> all = tile.all_lit(x, y);
    float lit = all.value_or(false) ? 1.f : 0.f;
    if (!all) {
      const Axes turned_key = key.turned(Turn(pixel_noise(tile.left + x, tile.top + y)));
      // Each corner takes every ring and every quarter of the lamp.
      Rays rays(*this);
      for (std::size_t s = 0; s < plain_lamp.size(); ++s)
        add_key(tile.corners[corners[(s + s / 4) % 4]], plain_lamp[s], turned_key, 0, rays);
      rays.shoot();
      lit = rays.groups[0].share();
    }
    Colour colour = 8 * shade(centre, from_sky, lit);
    for (const std::size_t c : corners) colour += shade(tile.corners[c], from_sky, lit);
    const std::size_t p = image.pixel(tile.left + x, tile.top + y);
    for (int k = 0; k < 3; ++k) image.rgba[4 * p + k] = colour[k] / 12;
    image.rgba[4 * p + 3] = 1;
  }

  void draw_samples(int x, int y, Image& image) const {
    const std::size_t p = image.pixel(x, y);
    const int n = options.samples, total = n * n;
    const Turn turn(pixel_noise(x, y));
    const Axes turned_key = key.turned(turn);
    Eigen::Array4f sum = Eigen::Array4f::Zero();
    // Two samples at a time, so that most of their rays go as many together as they can.
    for (int first = 0; first < total; first += 2) {
      const int last = std::min(first + 2, total);
      std::array<Vec3, 2> origin;
      std::array<Seen, 2> seen;
      std::array<bool, 2> met{};
      Rays rays(*this);
      for (int s = first; s < last; ++s) {
        const auto i = static_cast<std::size_t>(s - first);
        const int across = s % n, down = s / n;
        origin[i] = camera.place(x + (across + 0.5) / n, y + (down + 0.5) / n);
        met[i] = look(origin[i], false, seen[i]);
        if (!met[i]) continue;
        add_sky(seen[i], s, total, sample_rays, turn, 2 * i, rays);
        add_key(seen[i], sample_lamp[static_cast<std::size_t>(s)], turned_key, 2 * i + 1, rays);
      }
      rays.shoot();
      for (int s = first; s < last; ++s) {
        const auto i = static_cast<std::size_t>(s - first);
        Colour colour = Colour::Zero();
        float alpha = 0;
        if (met[i]) {
          const float open = rays.groups[2 * i].share();
          colour =
              shade(seen[i], sky_light(seen[i].colour, {&open, 1}), rays.groups[2 * i + 1].share());
          alpha = 1;
        }
        if (any_ghost) add_ghost(origin[i], seen[i].depth, colour, alpha);
        sum += Eigen::Array4f(colour[0], colour[1], colour[2], alpha);
      }
    }
    for (int k = 0; k < 4; ++k) image.rgba[4 * p + k] = sum[k] / static_cast<float>(total);
  }
};

Renderer::Renderer(std::vector<RenderPart> parts) {
  low_ = Vec3::Constant(kInfinity);
  high_ = -low_;
  for (RenderPart& part : parts) {
    for (const auto& v : part.mesh.vertices) {
      low_ = low_.cwiseMin(v.cast<double>());
      high_ = high_.cwiseMax(v.cast<double>());
    }
    parts_.emplace_back(std::move(part));
  }
  if (parts_.empty()) throw Error("there is nothing to draw");
}
Renderer::~Renderer() = default;
Renderer::Renderer(Renderer&&) noexcept = default;

std::vector<const TriangleMesh*> Renderer::meshes() const {
  std::vector<const TriangleMesh*> meshes;
  for (const Part& p : parts_) meshes.push_back(&p.part.mesh);
  return meshes;
}

Vec3 Renderer::middle() const { return 0.5 * (low_ + high_); }

Image Renderer::render(const Camera& camera, const RenderOptions& options) const {
  if (options.samples < 1 || options.samples > 16)
    throw Error("the samples per pixel must lie in 1 to 16 (each way)");
  if (options.ambient_rays < 0 || options.ambient_rays > 100000)
    throw Error("the ambient rays per pixel must lie in 0 to 100000");
  if (!(options.range > 0 && std::isfinite(options.range)))
    throw Error("the range of the deviation must be positive, in mm");
  if (!(options.ambient_reach >= 0 && std::isfinite(options.ambient_reach)))
    throw Error("the reach of the ambient light must not be negative");
  const double radius = std::max(0.5 * (high_ - low_).norm(), 1e-6);
  Pass pass{parts_,
            camera,
            options,
            options.ambient_reach > 0 ? options.ambient_reach : 0.3 * radius,
            2e-4 * radius,
            options.cut,
            {},
            {},
            {},
            {},
            Pass::sky_rays(rounded_up(options.ambient_rays, 12)),
            Pass::sky_rays(rounded_up(options.ambient_rays, options.samples * options.samples)),
            Pass::lamp_places(4),
            Pass::lamp_places(32),
            Pass::lamp_places(options.samples * options.samples),
            std::any_of(parts_.begin(), parts_.end(), [](const Part& p) { return p.part.ghost; })};
  if (pass.cut) {
    if (!pass.cut->point.allFinite() || !pass.cut->normal.allFinite() ||
        pass.cut->normal.stableNorm() == 0)
      throw Error("the cut's plane needs a point and a direction");
    pass.cut->normal = pass.cut->normal.stableNormalized();
  }
  const auto light = [&](double right, double up, double near) {
    return Vec3(right * camera.right + up * camera.up - near * camera.forward).normalized();
  };
  pass.key.w = light(-0.55, 0.70, 0.85);
  pass.key.u = pass.key.w.unitOrthogonal();
  pass.key.v = pass.key.w.cross(pass.key.u);
  pass.half = (pass.key.w - camera.forward).normalized();
  pass.fill = light(0.85, -0.15, 0.60);
  pass.sky = light(0, 0.8, 0.6);
  Image image = empty_image(camera);
  const int across = (camera.width + kTile - 1) / kTile;
  const int tiles = across * ((camera.height + kTile - 1) / kTile);
  std::atomic<int> drawn{0};  // tiles
  tbb::parallel_for(0, tiles, [&](int t) {
    const int before = drawn++;
    if (options.progress) options.progress(static_cast<double>(before) / tiles);
    pass.draw_tile(t % across * kTile, t / across * kTile, image);
  });
  return image;
}

}  // namespace toothprep
