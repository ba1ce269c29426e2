#include "toothprep/tools/mesh/creases.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
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
constexpr double kNear = 0.7;         // between the margin and where it's looked for
constexpr double kFarthest = 1.3;     // between a crease and the edge that it crosses
constexpr double kOffFace = 0.2;      // of the end of such an edge
constexpr double kWellFit = 0.03;     // the same, where no other faces are asked for
constexpr double kOnCrease = 0.02;    // from a face, of a point that lies on another
constexpr double kOutward = 0.1;      // cosine between a triangle and a face of the cut about it

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

// So many faces that explain the samples, of as many planes as can be; none if there are no such.
std::vector<CreaseFace> faces_of(const std::vector<CreaseFace>& all, std::size_t count,
                                 const CutSamples& s, bool removed) {
  if (all.size() < count) return {};
  std::vector<bool> taken(all.size());
  std::fill_n(taken.begin(), count, true);
  do {
    std::vector<CreaseFace> faces;
    for (std::size_t k = 0; k < all.size(); ++k)
      if (taken[k]) faces.push_back(all[k]);
    if (explain(faces, s, removed)) return faces;
  } while (std::prev_permutation(taken.begin(), taken.end()));
  return {};
}

// The point of three faces, looked for from a point.
std::optional<Vec3> corner_of(const std::vector<CreaseFace>& f, const Vec3& from) {
  Vec3 x = from;
  for (int step = 0; step < 4; ++step) {
    Eigen::Matrix3d m;
    m << f[0].gradient(x).transpose(), f[1].gradient(x).transpose(), f[2].gradient(x).transpose();
    if (std::abs(m.determinant()) < 0.2) return std::nullopt;
    x -= m.inverse() * Vec3(f[0].level(x), f[1].level(x), f[2].level(x));
    if ((x - from).norm() > 3) return std::nullopt;
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

// The point of both faces on the way through a point in a direction that follows the second.
std::optional<Vec3> met_on_way(const CreaseFace& face, const CreaseFace& tooth, const Vec3& from,
                               const Vec3& direction) {
  const Vec3 beside = direction.cross(tooth.gradient(from)).normalized();
  Vec3 x = from;
  for (int step = 0; step < 4; ++step) {
    Eigen::Matrix3d m;
    m << face.gradient(x).transpose(), tooth.gradient(x).transpose(), beside.transpose();
    if (!(std::abs(m.determinant()) > 0.1)) return std::nullopt;
    x -= m.inverse() * Vec3(face.level(x), tooth.level(x), beside.dot(x - from));
    if ((x - from).norm() > 3) return std::nullopt;
  }
  return x;
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

CreaseFace CreaseFace::shifted(double way) const {
  CreaseFace face = *this;
  face.terms[0] += way;
  return face;
}

Vec3 CreaseFace::gradient(const Vec3& at) const {
  const Vec3 d = at - origin;
  const double x = d.dot(axis[0]), y = d.dot(axis[1]);
  return axis[2] - (terms[1] + terms[3] * x + terms[4] * y) * axis[0] -
         (terms[2] + terms[4] * x + terms[5] * y) * axis[1];
}

std::optional<CreaseFace> face_near(const LevelSet& set, double voxel, const Index3& cell,
                                    const Vec3& at) {
  const CutSamples samples(set, voxel, cell);
  std::vector<SamplePlane> planes = planes_of(samples, false);
  const std::vector<SamplePlane> within = planes_of(samples, true);
  planes.insert(planes.end(), within.begin(), within.end());
  std::optional<CreaseFace> nearest;
  for (const auto& group : groups_of(planes)) {
    const CreaseFace face = fitted(group);
    if (!nearest || std::abs(face.level(at)) < std::abs(nearest->level(at)) - 1e-3) nearest = face;
  }
  return nearest;
}

CreaseFinder::CreaseFinder(const LevelSet& cut, double voxel, const Index3& cell) {
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
    std::vector<CreaseFace> faces;
    for (const auto& group : groups_of(planes)) faces.push_back(fitted(group));
    if (faces.size() > 4) faces.resize(4);
    for (const std::size_t count : {2, 3})
      if (std::vector<CreaseFace> its = faces_of(faces, count, *samples_, convex); !its.empty())
        wedges_.push_back({std::move(its), convex, 0});
  };
  for (const bool convex : {true, false}) add(planes_[convex], convex);
  for (const bool convex : {true, false}) add(planes_[!convex], convex);
  for (const bool convex : {true, false}) add(all, convex);
  std::erase_if(wedges_, [this](const Wedge& wedge) {
    const auto& f = wedge.faces;
    for (std::size_t a = 0; a < f.size(); ++a)
      for (std::size_t b = a + 1; b < f.size(); ++b)
        if (is_round(planes_[!wedge.convex], f[a], f[b], wedge.convex)) return true;
    return false;
  });
  for (Wedge& wedge : wedges_) wedge.misfit = std::max(wedge.misfit_of(all), kWellFit * kWellFit);
  std::stable_sort(wedges_.begin(), wedges_.end(), [](const Wedge& a, const Wedge& b) {
    return std::pair(a.misfit, a.faces.size()) < std::pair(b.misfit, b.faces.size());
  });
}
CreaseFinder::~CreaseFinder() = default;
CreaseFinder::CreaseFinder(CreaseFinder&&) noexcept = default;

// What was removed is where all faces of a convex edge have negative levels, or any of a reentrant
// one.
std::size_t CreaseFinder::Wedge::face_at(const Vec3& x) const {
  std::size_t its = 0;
  const double sign = convex ? 1 : -1;
  for (std::size_t k = 1; k < faces.size(); ++k)
    if (sign * faces[k].level(x) > sign * faces[its].level(x)) its = k;
  return its;
}

bool CreaseFinder::Wedge::is_before(const Vec3& x, std::size_t face, double slack) const {
  for (std::size_t k = 0; k < faces.size(); ++k)
    if (k != face && (convex ? 1 : -1) * faces[k].level(x) > slack) return false;
  return true;
}

// Mean square of the feet's distances.
double CreaseFinder::Wedge::misfit_of(const std::vector<SamplePlane>& planes) const {
  double sum = 0, weight = 0;
  for (const SamplePlane& p : planes) {
    const double level = faces[face_at(p.foot)].level(p.foot);
    sum += p.weight * std::min(level * level, 0.25);
    weight += p.weight;
  }
  return sum / weight;
}

Vec3 CreaseFinder::Wedge::middle(const Vec3& x) const {
  Vec3 sum = Vec3::Zero();
  for (const CreaseFace& face : faces) sum += face.gradient(x).normalized();
  return sum;
}

std::optional<double> CreaseFinder::crossing(const Vec3& a, const Vec3& b) const {
  for (const Wedge& wedge : wedges_)
    for (std::size_t k = 0; k < wedge.faces.size(); ++k) {
      const CreaseFace& face = wedge.faces[k];
      const double here = face.level(a), there = face.level(b);
      if ((here < 0) == (there < 0)) continue;
      double t = here / (here - there);
      for (int n = 0; n < 2; ++n)
        t -= face.level(a + t * (b - a)) / face.gradient(a + t * (b - a)).dot(b - a);
      if (t >= 0 && t <= 1 && wedge.is_before(a + t * (b - a), k, 1e-9)) return t;
    }
  return std::nullopt;
}

std::optional<Vec3> CreaseFinder::on_margin(const Vec3& x, const CreaseFace& tooth) const {
  for (const Wedge& wedge : wedges_) {
    std::optional<Vec3> nearest;
    for (std::size_t k = 0; k < wedge.faces.size(); ++k) {
      const std::optional<Vec3> at = met_on_way(wedge.faces[k], tooth, x, wedge.middle(x));
      if (at && (*at - x).norm() < (nearest ? (*nearest - x).norm() : kNear) &&
          wedge.is_before(*at, k, 1e-9))
        nearest = at;
    }
    if (nearest) return nearest;
  }
  return std::nullopt;
}

std::optional<Vec3> CreaseFinder::out_of_cut(const Vec3& x, const CreaseFace& tooth) const {
  const Wedge& wedge = wedges_.front();
  const auto distance = [&](const Vec3& at) { return wedge.faces[wedge.face_at(at)].level(at); };
  if (distance(x) >= kClear) return std::nullopt;
  const double clear = cleared(distance(x));
  std::optional<Vec3> nearest;
  for (const CreaseFace& face : wedge.faces) {
    const std::optional<Vec3> at = met_on_way(face.shifted(clear), tooth, x, wedge.middle(x));
    if (at && (*at - x).norm() < (nearest ? (*nearest - x).norm() : kNear) &&
        distance(*at) > 0.9 * clear)
      nearest = at;
  }
  return nearest;
}

std::optional<EdgeAtCrease> CreaseFinder::edge(const Vec3& u, const Vec3& v,
                                               const CreaseFace* tooth) const {
  std::optional<EdgeAtCrease> best;
  for (const Wedge& wedge : wedges_) {
    const std::optional<EdgeAtCrease> its = edge(wedge, u, v, tooth);
    if (its && (!best || its->misfit < best->misfit - kWellFit)) best = its;
    if (best && best->misfit < kWellFit) break;
  }
  return best;
}

std::optional<EdgeAtCrease> CreaseFinder::edge(const Wedge& wedge, const Vec3& u, const Vec3& v,
                                               const CreaseFace* tooth) const {
  const std::size_t a = wedge.face_at(u), b = wedge.face_at(v);
  const CreaseFace &at_u = wedge.faces[a], &at_v = wedge.faces[b];
  EdgeAtCrease edge{std::max(std::abs(at_u.level(u)), std::abs(at_v.level(v))),
                    false,
                    {false, false},
                    0.5,
                    u,
                    false};
  if (edge.misfit > kOffFace) return std::nullopt;
  const double from_u = std::abs(at_v.level(u)), from_v = std::abs(at_u.level(v));
  if (a == b) return edge;
  edge.on_crease = {from_u < kOnCrease, from_v < kOnCrease};
  if (edge.on_crease[0] || edge.on_crease[1]) return edge;
  edge.part = from_u / (from_u + from_v);
  const Vec3 middle = u + edge.part * (v - u);
  const std::optional<Vec3> at =
      tooth != nullptr ? corner_of({*tooth, at_u, at_v}, middle) : on_edge(at_u, at_v, middle);
  if (!at) return std::nullopt;
  edge.at = *at;
  for (std::size_t c = 0; tooth == nullptr && c < wedge.faces.size(); ++c)
    if (c != a && c != b && (wedge.convex ? 1 : -1) * wedge.faces[c].level(edge.at) > 0) {
      const std::optional<Vec3> corner = corner_of(wedge.faces, middle);
      if (!corner) return std::nullopt;
      edge.at = *corner;
      edge.is_corner = true;
    }
  if ((edge.at - middle).norm() > kFarthest || samples_->clear_of_surface(edge.at, kWithinBall))
    return std::nullopt;
  edge.crossed = true;
  return edge;
}

std::optional<Vec3> CreaseFinder::corner(const Vec3& x) const {
  for (const Wedge& wedge : wedges_) {
    if (wedge.faces.size() != 3) continue;
    std::optional<Vec3> at = corner_of(wedge.faces, x);
    if (at && (*at - x).norm() < kFarthest && !samples_->clear_of_surface(*at, kWithinBall))
      return at;
  }
  return std::nullopt;
}

bool CreaseFinder::faces_towards(const Vec3& direction) const {
  return std::any_of(normals_.begin(), normals_.end(),
                     [&](const Vec3& normal) { return direction.dot(normal) > kOutward; });
}

}  // namespace toothprep
