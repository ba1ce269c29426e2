#include "toothprep/tools/mesh/creases.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace toothprep {

namespace {

// Samples from kFirst to kLast about a cell are asked for their planes, and their neighbours up to
// two voxels farther for the gradient.
constexpr int kFirst = -1, kLast = 2, kHalo = 2, kStored = kLast - kFirst + 1 + 2 * kHalo;
constexpr double kReach = 1.6;        // of samples from the surface
constexpr double kFootReach = 1.9;    // of their feet from the cell's middle
constexpr double kFootSpread = 0.6;   // of the weights
constexpr double kEikonal = 0.06;     // by which a gradient may differ from 1
constexpr double kSameFace = 0.87;    // cosine between normals of one face, 30 degrees
constexpr double kWithinBall = 0.12;  // by which a point of the surface may lie in a sample's ball
constexpr double kFlatness = 0.02;    // weight of no curvature among the planes
constexpr double kLeastAngle = 0.4;   // sine, between the faces of an edge
constexpr double kLeastBend = 0.25;   // difference of slopes along an axis about a crease
constexpr double kNoFace = 0.94;      // cosine between normals of different faces, 20 degrees
constexpr double kRounded = 0.12;     // how deep under both faces a rounded edge may be
constexpr double kUnexplained = 0.2;  // of a sample's distance
constexpr double kNear = 0.5;         // between a crease and where it's looked for
constexpr double kInset = 0.03;       // a crease's vertex from its cell's faces

}  // namespace

class CutSamples {
 public:
  CutSamples(const LevelSet& cut, double voxel, const Index3& cell) {
    const int low = kFirst - kHalo;
    for (int x = 0; x < kStored; ++x)
      for (int y = 0; y < kStored; ++y)
        for (int z = 0; z < kStored; ++z)
          value_[x][y][z] = static_cast<float>(
              cut.value(cell.x() + low + x, cell.y() + low + y, cell.z() + low + z) / voxel);
  }
  // Relative to the cell.
  double at(const Index3& i) const {
    const int low = kFirst - kHalo;
    return value_[i.x() - low][i.y() - low][i.z() - low];
  }
  // By differences over three samples to one side or about it, along each axis where they bend
  // least, so not across a kink of the field.
  Vec3 gradient(const Index3& i) const {
    Vec3 g = Vec3::Zero();
    for (int axis = 0; axis < 3; ++axis) {
      const Index3 step = Index3::Unit(axis);
      const double a = at(i - 2 * step), b = at(i - step), c = at(i), d = at(i + step),
                   e = at(i + 2 * step);
      const std::array<double, 3> bend = {std::abs(a - 2 * b + c), std::abs(b - 2 * c + d),
                                          std::abs(c - 2 * d + e)};
      const std::array<double, 3> slope = {1.5 * c - 2 * b + a / 2, (d - b) / 2,
                                           -1.5 * c + 2 * d - e / 2};
      int least = 1;
      for (const int k : {0, 2})
        if (bend[k] < bend[least] - 1e-4) least = k;
      g[axis] = slope[least];
    }
    return g;
  }
  // Whether a point is so near to a sample that the surface can't be there.
  bool clear_of_surface(const Vec3& at, double slack) const {
    const Index3 base = at.array().floor().cast<int>();
    for (int x = -1; x <= 2; ++x)
      for (int y = -1; y <= 2; ++y)
        for (int z = -1; z <= 2; ++z) {
          const Index3 i = base + Index3(x, y, z);
          if (i.minCoeff() < kFirst - kHalo || i.maxCoeff() > kLast + kHalo) continue;
          const double distance = std::abs(this->at(i)) - slack;
          if (distance > 0 && (at - i.cast<double>()).squaredNorm() < distance * distance)
            return true;
        }
    return false;
  }

 private:
  float value_[kStored][kStored][kStored];
};

namespace {

std::vector<SamplePlane> planes_of(const CutSamples& s, bool removed) {
  std::vector<SamplePlane> planes;
  for (int x = kFirst; x <= kLast; ++x)
    for (int y = kFirst; y <= kLast; ++y)
      for (int z = kFirst; z <= kLast; ++z) {
        const Index3 i(x, y, z);
        const double u = s.at(i);
        if ((u < 0) != removed || std::abs(u) > kReach) continue;
        const Vec3 g = s.gradient(i);
        const double length = g.norm();
        if (std::abs(length - 1) > kEikonal) continue;
        const Vec3 normal = g / length, foot = i.cast<double>() - u * normal;
        const double d = (foot - Vec3::Constant(0.5)).norm();
        if (d > kFootReach || s.clear_of_surface(foot, 0.08)) continue;
        planes.push_back({normal, foot, std::exp(-d * d / (2 * kFootSpread * kFootSpread))});
      }
  return planes;
}

// The face of second order that fits the feet and the normals.
CreaseFace fitted(const std::vector<SamplePlane>& planes) {
  CreaseFace face;
  Vec3 normal = Vec3::Zero();
  face.origin = Vec3::Zero();
  double weight = 0;
  for (const SamplePlane& p : planes) {
    normal += p.weight * p.normal;
    face.origin += p.weight * p.foot;
    weight += p.weight;
  }
  face.origin /= weight;
  face.axis[2] = normal.normalized();
  face.axis[0] = face.axis[2].unitOrthogonal();
  face.axis[1] = face.axis[2].cross(face.axis[0]);
  using Row = Eigen::Matrix<double, 6, 1>;
  Eigen::Matrix<double, 6, 6> products = Eigen::Matrix<double, 6, 6>::Zero();
  Row sums = Row::Zero();
  const auto add = [&](const Row& row, double value, double w) {
    products += w * row * row.transpose();
    sums += w * value * row;
  };
  for (const SamplePlane& p : planes) {
    const Vec3 d = p.foot - face.origin;
    const double x = d.dot(face.axis[0]), y = d.dot(face.axis[1]), nz = p.normal.dot(face.axis[2]);
    if (nz < 0.2) continue;
    add(Row(1, x, y, x * x / 2, x * y, y * y / 2), d.dot(face.axis[2]), p.weight);
    add(Row(0, 1, 0, x, y, 0), -p.normal.dot(face.axis[0]) / nz, p.weight);
    add(Row(0, 0, 1, 0, x, y), -p.normal.dot(face.axis[1]) / nz, p.weight);
  }
  for (int k = 3; k < 6; ++k) products(k, k) += kFlatness * weight;
  face.terms = products.ldlt().solve(sums);
  return face;
}

// The planes of each face: of those whose normals are alike, from one to the next. The largest
// first.
std::vector<std::vector<SamplePlane>> groups_of(std::vector<SamplePlane> planes) {
  std::vector<std::vector<SamplePlane>> groups;
  while (!planes.empty()) {
    std::vector<SamplePlane> group = {planes.back()};
    planes.pop_back();
    for (std::size_t k = 0; k < group.size(); ++k) {
      const Vec3 normal = group[k].normal;
      const auto alike = std::stable_partition(
          planes.begin(), planes.end(),
          [&](const SamplePlane& p) { return p.normal.dot(normal) < kSameFace; });
      group.insert(group.end(), alike, planes.end());
      planes.erase(alike, planes.end());
    }
    groups.push_back(std::move(group));
  }
  std::stable_sort(groups.begin(), groups.end(),
                   [](const auto& a, const auto& b) { return a.size() > b.size(); });
  return groups;
}

// Whether the faces explain the samples of the cell that they were taken from.
bool explain(const std::vector<CreaseFace>& faces, const CutSamples& s, bool removed) {
  for (int c = 0; c < 8; ++c) {
    const Index3 i(c & 1, c >> 1 & 1, c >> 2);
    const double u = s.at(i);
    if ((u < 0) != removed) continue;
    double expected = removed ? -1e9 : 1e9;
    for (const CreaseFace& f : faces)
      expected = removed ? std::max(expected, f.level(i.cast<double>()))
                         : std::min(expected, f.level(i.cast<double>()));
    if (std::abs(expected - u) > kUnexplained) return false;
  }
  return true;
}

// Two or three faces that explain the samples, of as many planes as can be; none if there are no
// such.
std::vector<CreaseFace> faces_of(const std::vector<SamplePlane>& planes, const CutSamples& s,
                                 bool removed) {
  std::vector<CreaseFace> all;
  for (const auto& group : groups_of(planes)) all.push_back(fitted(group));
  if (all.size() > 4) all.resize(4);
  for (std::size_t count = std::min<std::size_t>(all.size(), 3); count >= 2; --count) {
    std::vector<bool> taken(all.size());
    std::fill_n(taken.begin(), count, true);
    do {
      std::vector<CreaseFace> faces;
      for (std::size_t k = 0; k < all.size(); ++k)
        if (taken[k]) faces.push_back(all[k]);
      if (explain(faces, s, removed)) return faces;
    } while (std::prev_permutation(taken.begin(), taken.end()));
  }
  return {};
}

// The nearest point in the cell and not on its faces.
Vec3 within_cell(const Vec3& x) { return x.cwiseMax(kInset).cwiseMin(1 - kInset); }

// The part of a line within a cell, as parameters; empty if first > second.
std::array<double, 2> clipped(const Vec3& at, const Vec3& direction, const Index3& cell) {
  double first = -1e9, last = 1e9;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = cell[axis] - at[axis];
    if (std::abs(direction[axis]) < 1e-9) {
      if (low > 0 || low < -1) return {1, 0};
      continue;
    }
    const double a = low / direction[axis], b = (low + 1) / direction[axis];
    first = std::max(first, std::min(a, b));
    last = std::min(last, std::max(a, b));
  }
  return {first, last};
}

std::optional<Vec3> corner_of(const std::vector<CreaseFace>& f) {
  Vec3 x = Vec3::Constant(0.5);
  for (int step = 0; step < 4; ++step) {
    Eigen::Matrix3d m;
    m << f[0].gradient(x).transpose(), f[1].gradient(x).transpose(), f[2].gradient(x).transpose();
    if (std::abs(m.determinant()) < 0.2) return std::nullopt;
    x -= m.inverse() * Vec3(f[0].level(x), f[1].level(x), f[2].level(x));
    if ((x - Vec3::Constant(0.5)).norm() > 3) return std::nullopt;
  }
  return x;
}

// The point of both faces that lies in the plane through a point and normal to their edge.
std::optional<Vec3> on_edge(const CreaseFace& a, const CreaseFace& b, const Vec3& from) {
  Vec3 x = from;
  for (int step = 0; step < 4; ++step) {
    const Vec3 u = a.gradient(x), v = b.gradient(x), along = u.cross(v);
    if (along.norm() < kLeastAngle * u.norm() * v.norm()) return std::nullopt;
    Eigen::Matrix3d m;
    m << u.transpose(), v.transpose(), along.transpose();
    x -= m.inverse() * Vec3(a.level(x), b.level(x), along.dot(x - from));
    if ((x - from).norm() > 3) return std::nullopt;
  }
  return x;
}

// The middle of the part of the edge between faces a and b that lies before the third face and in a
// cell.
std::optional<Vec3> edge_of(const std::vector<CreaseFace>& f, std::size_t a, std::size_t b,
                            bool removed, const Index3& cell) {
  const std::optional<Vec3> at = on_edge(f[a], f[b], Vec3::Constant(0.5));
  if (!at) return std::nullopt;
  const Vec3 direction = f[a].gradient(*at).cross(f[b].gradient(*at));
  auto [first, last] = clipped(*at, direction, cell);
  for (std::size_t c = 0; c < f.size(); ++c) {
    if (c == a || c == b) continue;
    // Beyond the third face is no edge: its level has to be negative for a convex one.
    const double sign = removed ? 1 : -1, here = sign * f[c].level(*at),
                 slope = sign * f[c].gradient(*at).dot(direction);
    if (std::abs(slope) < 1e-9) {
      if (here > 0) return std::nullopt;
    } else if (slope > 0) {
      last = std::min(last, -here / slope);
    } else {
      first = std::max(first, -here / slope);
    }
  }
  if (first > last) return std::nullopt;
  return on_edge(f[a], f[b], *at + (first + last) / 2 * direction);
}

// Whether the edge of two faces is round: on the side from which it is reentrant, samples have
// their feet on it, with normals between those of the faces; these feet lie under both faces unless
// it's sharp.
bool is_round(const std::vector<SamplePlane>& other_side, const CreaseFace& a, const CreaseFace& b,
              bool removed) {
  const double sign = removed ? 1 : -1;
  return std::any_of(other_side.begin(), other_side.end(), [&](const SamplePlane& p) {
    const Vec3 u = a.gradient(p.foot).normalized(), v = b.gradient(p.foot).normalized();
    return p.weight > 0.05 && p.normal.dot(u) < kNoFace && p.normal.dot(v) < kNoFace &&
           std::abs(p.normal.dot(u.cross(v).normalized())) < 0.3 &&
           sign * a.level(p.foot) < -kRounded && sign * b.level(p.foot) < -kRounded;
  });
}

// Whether the surface passes through the cell and the field bends about it: the slopes along an
// axis of the lattice differ.
bool bends(const LevelSet& cut, double voxel, const Index3& cell) {
  constexpr int kSide = kLast - kFirst + 1;
  float u[kSide][kSide][kSide];
  for (int x = 0; x < kSide; ++x)
    for (int y = 0; y < kSide; ++y)
      for (int z = 0; z < kSide; ++z)
        u[x][y][z] = cut.value(cell.x() + kFirst + x, cell.y() + kFirst + y, cell.z() + kFirst + z);
  std::array<float, 3> least, most;
  least.fill(std::numeric_limits<float>::max());
  most.fill(std::numeric_limits<float>::lowest());
  const auto add = [&](int axis, float slope) {
    least[axis] = std::min(least[axis], slope);
    most[axis] = std::max(most[axis], slope);
  };
  for (int a = 0; a + 1 < kSide; ++a)
    for (int b = 1; b <= 2; ++b)
      for (int c = 1; c <= 2; ++c) {
        add(0, u[a + 1][b][c] - u[a][b][c]);
        add(1, u[b][a + 1][c] - u[b][a][c]);
        add(2, u[b][c][a + 1] - u[b][c][a]);
      }
  for (int axis = 0; axis < 3; ++axis)
    if (most[axis] - least[axis] > kLeastBend * voxel) return true;
  return false;
}

}  // namespace

double CreaseFace::level(const Vec3& at) const {
  const Vec3 d = at - origin;
  const double x = d.dot(axis[0]), y = d.dot(axis[1]);
  return d.dot(axis[2]) - terms[0] - terms[1] * x - terms[2] * y - terms[3] * x * x / 2 -
         terms[4] * x * y - terms[5] * y * y / 2;
}

Vec3 CreaseFace::gradient(const Vec3& at) const {
  const Vec3 d = at - origin;
  const double x = d.dot(axis[0]), y = d.dot(axis[1]);
  return axis[2] - (terms[1] + terms[3] * x + terms[4] * y) * axis[0] -
         (terms[2] + terms[4] * x + terms[5] * y) * axis[1];
}

std::optional<double> Crease::crossing(const Index3& from, int axis) const {
  const Vec3 a = from.cast<double>(), step = Vec3::Unit(axis);
  for (const CreaseFace& face : faces) {
    double here = face.level(a), there = face.level(a + step);
    if ((here < 0) == (there < 0)) continue;
    double t = here / (here - there);
    for (int k = 0; k < 2; ++k) t -= face.level(a + t * step) / face.gradient(a + t * step)[axis];
    if (!(t >= 0 && t <= 1)) continue;
    const bool on_surface = std::all_of(faces.begin(), faces.end(), [&](const CreaseFace& other) {
      return &other == &face || (other.level(a + t * step) <= 0) == convex;
    });
    if (on_surface) return t;
  }
  return std::nullopt;
}

CreaseFinder::CreaseFinder(const LevelSet& cut, double voxel, const Index3& cell) : cell_(cell) {
  if (!bends(cut, voxel, cell)) return;
  samples_ = std::make_unique<CutSamples>(cut, voxel, cell);
  for (const bool removed : {false, true}) {
    planes_[removed] = planes_of(*samples_, removed);
    for (const auto& group : groups_of(planes_[removed])) normals_.push_back(fitted(group).axis[2]);
  }
  std::vector<SamplePlane> all = planes_[0];
  all.insert(all.end(), planes_[1].begin(), planes_[1].end());
  // Samples on the side from which an edge is convex know its faces best; but where there are few,
  // the others do.
  const auto add = [&](const std::vector<SamplePlane>& planes, bool convex) {
    std::vector<CreaseFace> faces = faces_of(planes, *samples_, convex);
    if (!faces.empty()) wedges_.push_back({std::move(faces), convex});
  };
  for (const bool convex : {true, false}) add(planes_[convex], convex);
  for (const bool convex : {true, false}) add(planes_[!convex], convex);
  for (const bool convex : {true, false}) add(all, convex);
}
CreaseFinder::~CreaseFinder() = default;

std::optional<Crease> CreaseFinder::in(const Index3& cell) const {
  const Index3 there = cell - cell_;
  for (const auto& [faces, convex] : wedges_) {
    const auto fits = [&](const std::optional<Vec3>& x) {
      return x && (*x - there.cast<double>() - Vec3::Constant(0.5)).cwiseAbs().maxCoeff() < 0.55 &&
             !samples_->clear_of_surface(*x, kWithinBall);
    };
    std::optional<Vec3> at;
    if (faces.size() == 3) at = corner_of(faces);
    for (std::size_t a = 0; !fits(at) && a < faces.size(); ++a)
      for (std::size_t b = a + 1; !fits(at) && b < faces.size(); ++b) {
        at = edge_of(faces, a, b, convex, there);
        if (is_round(planes_[!convex], faces[a], faces[b], convex)) at.reset();
      }
    if (fits(at)) return crease_at(cell == cell_ ? within_cell(*at) : *at, faces, convex);
  }
  return std::nullopt;
}

std::optional<Crease> CreaseFinder::near(const Vec3& x) const {
  const Vec3 from = x - cell_.cast<double>();
  for (const auto& [faces, convex] : wedges_)
    for (std::size_t a = 0; a < faces.size(); ++a)
      for (std::size_t b = a + 1; b < faces.size(); ++b) {
        const std::optional<Vec3> at = on_edge(faces[a], faces[b], from);
        if (at && (*at - from).norm() < kNear && !samples_->clear_of_surface(*at, kWithinBall) &&
            !is_round(planes_[!convex], faces[a], faces[b], convex))
          return crease_at(*at, faces, convex);
      }
  return std::nullopt;
}

Crease CreaseFinder::crease_at(const Vec3& at, const std::vector<CreaseFace>& faces,
                               bool convex) const {
  const Vec3 cell = cell_.cast<double>();
  Crease crease;
  crease.convex = convex;
  crease.faces = faces;
  crease.normals = normals_;
  crease.at = cell + at;
  crease.within = cell + within_cell(at);
  crease.into = Vec3::Zero();
  for (CreaseFace& f : crease.faces) {
    crease.into += (convex ? -1 : 1) * f.gradient(at).normalized();
    f.origin += cell;
  }
  crease.into.normalize();
  return crease;
}

}  // namespace toothprep
