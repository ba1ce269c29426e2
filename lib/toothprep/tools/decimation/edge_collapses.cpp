#include "toothprep/tools/decimation/edge_collapses.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_simplification/Edge_collapse_visitor_base.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/LindstromTurk_cost.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/LindstromTurk_placement.h>
#include <CGAL/Surface_mesh_simplification/edge_collapse.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/decimation/feature_lines.h"
#include "toothprep/tools/mesh/nearest_in_triangle.h"

namespace toothprep {
namespace {

namespace sms = CGAL::Surface_mesh_simplification;
using Point = CGAL::Simple_cartesian<double>::Point_3;
using Mesh = CGAL::Surface_mesh<Point>;
using Vertex = Mesh::Vertex_index;
using Face = Mesh::Face_index;

constexpr double kLeastCosine = 0.5;    // between a triangle's normals before and after
constexpr double kLeastQuality = 0.02;  // of a new triangle; 1 is equilateral
constexpr double kNear = 0.5;           // of the tolerance: no nearer triangle is looked for
constexpr int kMostRefusals = 8;        // of an edge
constexpr int kRefusedLater = 4;        // doublings of the cost at each refusal

Vec3 vec(const Point& p) { return Vec3(p.x(), p.y(), p.z()); }

template <class SurfaceMesh>
SurfaceMesh half_edges_of(const TriangleMesh& mesh) {
  SurfaceMesh result;
  for (const auto& v : mesh.vertices)
    result.add_vertex(typename SurfaceMesh::Point(v.x(), v.y(), v.z()));
  using V = typename SurfaceMesh::Vertex_index;
  for (const auto& t : mesh.triangles)
    if (result.add_face(V(t[0]), V(t[1]), V(t[2])) == SurfaceMesh::null_face())
      throw Error("the mesh to decimate is not 2-manifold");
  if (!CGAL::is_closed(result)) throw Error("the mesh to decimate is not closed");
  return result;
}

double quality(const Corners& c, double twice_area) {
  const double sides =
      (c[1] - c[0]).squaredNorm() + (c[2] - c[1]).squaredNorm() + (c[0] - c[2]).squaredNorm();
  return sides > 0 ? 2 * std::sqrt(3.0) * twice_area / sides : 0;
}

struct Replaced {  // a triangle about the new vertex
  Face face;
  Corners corners;
  std::vector<std::uint32_t> given;
};

// What the pass knows, and the two decisions that it makes: where an edge's vertices go, if at all,
// and what follows from it.
class Pass {
 public:
  using Profile = sms::Edge_profile<Mesh>;
  using Placement = boost::optional<Point>;

  Pass(const TriangleMesh& given, const std::vector<std::array<std::uint32_t, 2>>& lines,
       const TriangleTree& tree, const std::vector<double>& tolerance, double line_tolerance)
      : given_(given),
        tree_(tree),
        tolerance_(tolerance),
        line_tolerance_(line_tolerance),
        mesh_(half_edges_of<Mesh>(given)),
        lines_(points_of(given), lines),
        fixed_(given.vertices.size(), 0),
        given_of_(given.triangles.size()),
        refused_(mesh_.num_edges(), 0),
        failed_of_(mesh_.num_edges(), UINT32_MAX) {
    for (const auto& t : given.triangles)
      if (given.triangle_tissue.empty() &&
          (given.tissue[t[0]] != given.tissue[t[1]] || given.tissue[t[1]] != given.tissue[t[2]]))
        for (const std::uint32_t v : t) fixed_[v] = 1;
    for (std::uint32_t v = 0; v < fixed_.size(); ++v) {
      if (tolerance[v] <= 0) fixed_[v] = 1;
      given_of_[mesh_.face(mesh_.halfedge(Vertex(v)))].push_back(v);
    }
  }

  Mesh& mesh() { return mesh_; }

  // The collapse of this edge comes next, if it is placed.
  void selected(const Profile& edge) { selected_ = mesh_.edge(edge.v0_v1()); }

  // CGAL asks for a place to know the cost, and again before the collapse: only then it is judged.
  Placement place(const Profile& edge) {
    const Mesh::Edge_index e = mesh_.edge(edge.v0_v1());
    const bool decides = selected_ == e;
    selected_ = Mesh::null_edge();
    const std::uint32_t a = edge.v0(), b = edge.v1();
    const bool a_stays = fixed_[a] || lines_.on_line(a), b_stays = fixed_[b] || lines_.on_line(b);
    Placement placement;
    if (a_stays && b_stays)
      placement = place_on_line(edge);
    else
      placement = a_stays ? edge.p0() : b_stays ? Placement(edge.p1()) : place_(edge);
    if (!placement || !decides) return placement;
    if (vec(*placement).allFinite() && fits(edge, vec(*placement))) return placement;
    ++refused_[e];
    return {};
  }

  // Infinite for what is not to be tried any more; what was refused comes later than before.
  boost::optional<double> cost(const Profile& edge, const Placement& placement) const {
    const int refused = refused_[mesh_.edge(edge.v0_v1())];
    if (!placement || refused >= kMostRefusals) return std::numeric_limits<double>::infinity();
    const boost::optional<double> plain = cost_(edge, placement);
    if (!plain) return std::numeric_limits<double>::infinity();
    return std::ldexp(*plain, kRefusedLater * refused);
  }

  void collapsed(const Profile& edge, Vertex kept) {
    const std::uint32_t a = edge.v0(), b = edge.v1(), v = kept, gone = v == a ? b : a;
    if (lines_.on_line(a) && lines_.on_line(b)) {
      const std::uint32_t removed = removed_of_line_, stays = removed == a ? b : a;
      lines_.remove(removed, stays);
    }
    if (lines_.on_line(gone)) lines_.rename(gone, v);
    fixed_[v] = fixed_[a] || fixed_[b];
    for (Replaced& r : star_) given_of_[r.face] = std::move(r.given);
  }

  Collapsed result() const;

 private:
  static std::vector<Vec3> points_of(const TriangleMesh& mesh) {
    std::vector<Vec3> points;
    for (const auto& v : mesh.vertices) points.push_back(v.cast<double>());
    return points;
  }

  Placement place_on_line(const Profile& edge) {
    const std::uint32_t a = edge.v0(), b = edge.v1();
    const double without_a = fixed_[a] ? FeatureLines::kNever : lines_.deviation_without(a, b);
    const double without_b = fixed_[b] ? FeatureLines::kNever : lines_.deviation_without(b, a);
    if (std::min(without_a, without_b) > line_tolerance_) return {};
    removed_of_line_ = without_a <= without_b ? a : b;
    return removed_of_line_ == a ? edge.p1() : edge.p0();
  }

  bool fits(const Profile& edge, const Vec3& x) {
    return star_fits(edge, x) && place_given(edge) && near_given(edge, x);
  }
  bool star_fits(const Profile& edge, const Vec3& x);
  std::pair<Replaced*, double> triangle_for(std::uint32_t given_vertex);
  bool place_given(const Profile& edge);
  bool near_given(const Profile& edge, const Vec3& x) const;

  const TriangleMesh& given_;
  const TriangleTree& tree_;
  const std::vector<double>& tolerance_;
  double line_tolerance_;
  Mesh mesh_;
  FeatureLines lines_;
  sms::LindstromTurk_placement<Mesh> place_;
  sms::LindstromTurk_cost<Mesh> cost_;
  std::vector<char> fixed_;                           // per vertex of mesh_
  std::vector<std::vector<std::uint32_t>> given_of_;  // per face of mesh_: given vertices
  Mesh::Edge_index selected_ = Mesh::null_edge();
  std::vector<char> refused_;             // per edge of mesh_: how often
  std::vector<std::uint32_t> failed_of_;  // per edge of mesh_: the given vertex that forbade it
  // Of the edge that was placed last:
  std::vector<Replaced> star_;
  std::vector<std::uint32_t> moved_;  // given vertices of its triangles
  double least_tolerance_ = 0;        // of them
  std::uint32_t removed_of_line_ = 0;
};

// The triangles that the collapse leaves, and whether none of them turns over or is a sliver.
bool Pass::star_fits(const Profile& edge, const Vec3& x) {
  star_.clear();
  moved_.clear();
  const Face left = mesh_.face(edge.v0_v1()), right = mesh_.face(edge.v1_v0());
  const auto take_given = [&](Face f) {
    moved_.insert(moved_.end(), given_of_[f].begin(), given_of_[f].end());
  };
  take_given(left);
  take_given(right);
  for (const Vertex v : {edge.v0(), edge.v1()})
    for (const auto h : CGAL::halfedges_around_target(v, mesh_)) {
      const Face f = mesh_.face(h);
      if (f == left || f == right) continue;
      const Vec3 p = vec(mesh_.point(mesh_.target(mesh_.next(h)))),
                 q = vec(mesh_.point(mesh_.source(h))), old = vec(mesh_.point(v));
      const Vec3 before = (p - old).cross(q - old), after = (p - x).cross(q - x);
      const double size = after.norm();
      if (before.dot(after) < kLeastCosine * before.norm() * size) return false;
      const double new_quality = quality({x, p, q}, size);
      if (new_quality < kLeastQuality && new_quality < quality({old, p, q}, before.norm()))
        return false;
      star_.push_back({f, {x, p, q}, {}});
      take_given(f);
    }
  return true;
}

// The first triangle that is near enough not to look further, else the nearest; its distance.
std::pair<Replaced*, double> Pass::triangle_for(std::uint32_t given_vertex) {
  const Vec3 x = given_.vertices[given_vertex].cast<double>();
  std::pair<Replaced*, double> nearest{nullptr, std::numeric_limits<double>::infinity()};
  for (Replaced& r : star_) {
    const double distance = distance_to_triangle(r.corners, x);
    if (distance >= nearest.second) continue;
    nearest = {&r, distance};
    if (distance <= kNear * tolerance_[given_vertex]) break;
  }
  return nearest;
}

// Each given vertex to a triangle within its tolerance. What failed the last time is likely to fail
// again, so it comes first.
bool Pass::place_given(const Profile& edge) {
  std::uint32_t& failed = failed_of_[mesh_.edge(edge.v0_v1())];
  const auto first = std::find(moved_.begin(), moved_.end(), failed);
  if (first != moved_.end()) std::iter_swap(moved_.begin(), first);
  least_tolerance_ = std::numeric_limits<double>::infinity();
  for (const std::uint32_t v : moved_) {
    const auto [triangle, distance] = triangle_for(v);
    if (!triangle || distance > tolerance_[v]) {
      failed = v;
      return false;
    }
    triangle->given.push_back(v);
    least_tolerance_ = std::min(least_tolerance_, tolerance_[v]);
  }
  return true;
}

// The new vertex, and of each new triangle the middle and those of its new edges.
bool Pass::near_given(const Profile& edge, const Vec3& x) const {
  const auto far = [&](const Vec3& p) { return tree_.nearest(p).distance > least_tolerance_; };
  if (x != vec(edge.p0()) && x != vec(edge.p1()) && far(x)) return false;
  return std::none_of(star_.begin(), star_.end(), [&](const Replaced& r) {
    const auto& [apex, p, q] = r.corners;
    return far((apex + p) / 2) || far((apex + p + q) / 3);
  });
}

Collapsed Pass::result() const {
  Collapsed result;
  std::vector<std::uint32_t> number(mesh_.num_vertices());
  std::uint32_t count = 0;
  for (const Vertex v : mesh_.vertices()) {
    number[v] = count++;
    result.mesh.vertices.push_back(vec(mesh_.point(v)).cast<float>());
    result.mesh.tissue.push_back(given_.tissue[v]);
  }
  for (const Face f : mesh_.faces()) {
    const auto h = mesh_.halfedge(f);
    result.mesh.triangles.push_back(
        {number[mesh_.source(h)], number[mesh_.target(h)], number[mesh_.target(mesh_.next(h))]});
    result.given.push_back(given_of_[f]);
    if (!given_.triangle_tissue.empty())
      result.mesh.triangle_tissue.push_back(given_.triangle_tissue[f]);
  }
  for (const auto& [a, b] : lines_.edges()) result.lines.push_back({number[a], number[b]});
  result.greatest_of_lines_mm = lines_.greatest_deviation();
  return result;
}

struct BoundedPlacement {
  Pass* pass;
  template <class Profile>
  boost::optional<Point> operator()(const Profile& edge) const {
    return pass->place(edge);
  }
};

struct GrowingCost {
  const Pass* pass;
  template <class Profile, class Placement>
  boost::optional<double> operator()(const Profile& edge, const Placement& placement) const {
    return pass->cost(edge, placement);
  }
};

struct Followed : sms::Edge_collapse_visitor_base<Mesh> {
  explicit Followed(Pass* p) : pass(p) {}
  Pass* pass;
  template <class Profile, class Cost, class Count>
  void OnSelected(const Profile& edge, const Cost&, Count, Count) const {
    pass->selected(edge);
  }
  template <class Profile>
  void OnCollapsed(const Profile& edge, Vertex kept) const {
    pass->collapsed(edge, kept);
  }
};

struct StopAtRefused {
  template <class Cost, class Profile, class Count>
  bool operator()(const Cost& cost, const Profile&, Count, Count) const {
    return std::isinf(cost);
  }
};

}  // namespace

Collapsed collapse_edges(const TriangleMesh& mesh,
                         const std::vector<std::array<std::uint32_t, 2>>& lines,
                         const TriangleTree& tree, const std::vector<double>& tolerance_mm,
                         double line_tolerance_mm) {
  Pass pass(mesh, lines, tree, tolerance_mm, line_tolerance_mm);
  sms::edge_collapse(pass.mesh(), StopAtRefused(),
                     CGAL::parameters::get_cost(GrowingCost{&pass})
                         .get_placement(BoundedPlacement{&pass})
                         .visitor(Followed(&pass)));
  return pass.result();
}

std::vector<std::uint32_t> intersecting_triangles(const TriangleMesh& mesh) {
  using Exact = CGAL::Surface_mesh<CGAL::Exact_predicates_inexact_constructions_kernel::Point_3>;
  const Exact judged = half_edges_of<Exact>(mesh);
  std::vector<std::pair<Exact::Face_index, Exact::Face_index>> pairs;
  CGAL::Polygon_mesh_processing::self_intersections<CGAL::Sequential_tag>(
      judged, std::back_inserter(pairs));
  std::vector<std::uint32_t> triangles;
  for (const auto& [a, b] : pairs) {
    triangles.push_back(a);
    triangles.push_back(b);
  }
  std::sort(triangles.begin(), triangles.end());
  triangles.erase(std::unique(triangles.begin(), triangles.end()), triangles.end());
  return triangles;
}

}  // namespace toothprep
