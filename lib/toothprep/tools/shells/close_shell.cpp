// From a scan's triangles to a shell without faults; closing.h says what is done and what is not.
#include <CGAL/Polygon_mesh_processing/border.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/repair_degeneracies.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Polygon_mesh_processing/triangulate_hole.h>
#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <numeric>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/shells/closing.h"
#include "toothprep/tools/shells/shell_topology.h"

namespace toothprep {

using namespace shell_topology;

namespace {

namespace pmp = CGAL::Polygon_mesh_processing;

constexpr double kWidestHole = 3;       // mm, of one that is filled by continuing the surface
constexpr double kWidestShare = 0.4;    // of the whole, likewise
constexpr double kSeam = 2e-3;          // mm between points of a seam that are one
constexpr double kLoosePart = 0.01;     // of the largest part's area
constexpr double kFewFaces = 0.02;      // of all, that may be cut out where they are bad
constexpr double kFlatRim = 0.1;        // mm that a flat rim strays from its plane
constexpr double kBelowRim = 0.2;       // mm from an uneven rim's farthest point to the base
constexpr double kMostStray = 1.0 / 3;  // of the rim's width
constexpr double kLeastHeight = 0.15;   // of the piece above its rim, of the rim's width
constexpr double kMostBeyond = 0.25;    // of the piece's area, beyond the rim's plane

using Notes = std::vector<std::string>;

// ---- Bad faces and points

std::size_t remove_idle_faces(Shell& shell) {
  const auto first = first_alike(shell);
  std::vector<char> keep(shell.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) {
    const auto& v = shell.triangles[t];
    keep[t] = v[0] != v[1] && v[1] != v[2] && v[2] != v[0] && first[t] == t;
  }
  const auto gone = static_cast<std::size_t>(std::count(keep.begin(), keep.end(), 0));
  if (gone > 0) shell = kept_faces(shell, keep);
  return gone;
}

// Points of borders that are as good as one become one.
void join_seams(Shell& shell, Notes& notes) {
  std::vector<std::uint32_t> border;
  for_each_edge(half_edges(shell), [&](const HalfEdge* e, const HalfEdge* end) {
    if (end - e == 1) border.insert(border.end(), {e->low, e->high});
  });
  const auto x = [&](std::uint32_t p) { return shell.points[p].x(); };
  std::sort(border.begin(), border.end(),
            [&](std::uint32_t a, std::uint32_t b) { return x(a) != x(b) ? x(a) < x(b) : a < b; });
  border.erase(std::unique(border.begin(), border.end()), border.end());
  std::vector<std::uint32_t> parent(shell.points.size());
  std::iota(parent.begin(), parent.end(), 0U);
  for (std::size_t i = 0; i < border.size(); ++i)
    for (std::size_t j = i + 1; j < border.size() && x(border[j]) - x(border[i]) <= kSeam; ++j)
      if ((shell.points[border[i]] - shell.points[border[j]]).norm() <= kSeam)
        join(parent, border[i], border[j]);
  std::size_t joined = 0;
  std::uint32_t first = 0;
  for (const std::uint32_t p : border)
    if (root_of(parent, p) != p && joined++ == 0) first = p;
  if (joined == 0) return;
  for (auto& t : shell.triangles)
    for (auto& p : t) p = root_of(parent, p);
  notes.push_back("joined " + count_of(joined, "point", "points") +
                  " of a seam to others less than 2 um away, near " + at(shell.points[first]));
  remove_idle_faces(shell);
}

// Whether the faces that must go (1 in `bad`) are damage and not another shape: few, and what hangs
// together by points no wider than a hole that is filled.
bool is_damage(const Shell& shell, const std::vector<char>& bad) {
  const auto count = static_cast<double>(std::count(bad.begin(), bad.end(), 1));
  if (count > std::max(4.0, kFewFaces * static_cast<double>(bad.size()))) return false;
  std::vector<std::uint32_t> parent(shell.points.size());
  std::iota(parent.begin(), parent.end(), 0U);
  for (std::size_t t = 0; t < bad.size(); ++t)
    if (bad[t]) {
      join(parent, shell.triangles[t][0], shell.triangles[t][1]);
      join(parent, shell.triangles[t][1], shell.triangles[t][2]);
    }
  std::map<std::uint32_t, Box> boxes;
  for (std::size_t t = 0; t < bad.size(); ++t) {
    if (!bad[t]) continue;
    const Vec3 at = centre(shell, t);
    Box& box = boxes.try_emplace(root_of(parent, shell.triangles[t][0]), Box{at, at}).first->second;
    for (const std::uint32_t p : shell.triangles[t])
      box = {box.min.cwiseMin(shell.points[p]), box.max.cwiseMax(shell.points[p])};
  }
  return std::all_of(boxes.begin(), boxes.end(), [](const auto& b) {
    return (b.second.max - b.second.min).maxCoeff() <= kWidestHole;
  });
}

void cut_out(Shell& shell, const std::vector<char>& bad, const std::string& why, Notes& notes) {
  std::vector<char> keep(bad.size());
  std::size_t count = 0, first = 0;
  for (std::size_t t = bad.size(); t-- > 0;) {
    keep[t] = bad[t] == 0;
    if (!keep[t]) {
      ++count;
      first = t;
    }
  }
  notes.push_back("cut out " + count_of(count, "face", "faces") + " " + why + ", near " +
                  at(centre(shell, first)));
  shell = kept_faces(shell, keep);
}

// Edges of more than two faces: what ends in the open there goes first, then all of them.
void cut_crowded_edges(Shell& shell, Notes& notes) {
  for (int round = 0; round < 10; ++round) {
    const auto edges = half_edges(shell);
    std::vector<char> at_border(shell.triangles.size(), 0), bad = at_border, fin = at_border;
    for_each_edge(edges, [&](const HalfEdge* e, const HalfEdge* end) {
      if (end - e == 1) at_border[e->corner / 3] = 1;
    });
    bool fins = false, crowded = false;
    for_each_edge(edges, [&](const HalfEdge* e, const HalfEdge* end) {
      if (end - e <= 2) return;
      crowded = true;
      for (; e < end; ++e) {
        bad[e->corner / 3] = 1;
        fin[e->corner / 3] = at_border[e->corner / 3];
        fins = fins || at_border[e->corner / 3] != 0;
      }
    });
    if (!crowded || !is_damage(shell, bad)) return;
    cut_out(shell, fins ? fin : bad, "that share an edge with two others", notes);
  }
}

// What floats beside a scan.
void drop_loose_parts(Shell& shell, Notes& notes) {
  const auto edges = half_edges(shell);
  const Parts parts = parts_of(shell, edges);
  std::vector<char> loose(parts.area.size(), 0);
  for_each_edge(edges, [&](const HalfEdge* e, const HalfEdge* end) {
    const std::uint32_t part = parts.of[e->corner / 3];
    if (end - e == 1 && parts.area[part] < kLoosePart * parts.area[0]) loose[part] = 1;
  });
  const auto count = static_cast<std::size_t>(std::count(loose.begin(), loose.end(), 1));
  if (count == 0) return;
  std::vector<char> keep(shell.triangles.size());
  double area = 0;
  for (std::size_t p = 0; p < loose.size(); ++p) area += loose[p] ? parts.area[p] : 0;
  std::size_t first = shell.triangles.size();
  for (std::size_t t = shell.triangles.size(); t-- > 0;) {
    keep[t] = loose[parts.of[t]] == 0;
    if (!keep[t]) first = t;
  }
  notes.push_back(fmt::format("left out {} of together {:.2g} mm2, near {}",
                              count_of(count, "loose piece", "loose pieces"), area,
                              at(centre(shell, first))));
  shell = kept_faces(shell, keep);
}

// False if faces share edges in a way that has no sides.
bool turn_flipped(Shell& shell, Notes& notes) {
  const auto edges = half_edges(shell);
  bool crowded = false;
  for_each_edge(edges,
                [&](const HalfEdge* e, const HalfEdge* end) { crowded = crowded || end - e > 2; });
  const Turn turn = turns_needed(shell, edges);
  if (crowded || !turn.possible) return false;
  if (turn.count == 0) return true;
  std::size_t first = 0;
  while (!turn.triangle[first]) ++first;
  notes.push_back("turned " + count_of(turn.count, "flipped face", "flipped faces") + ", near " +
                  at(centre(shell, first)));
  for (std::size_t t = first; t < shell.triangles.size(); ++t)
    if (turn.triangle[t]) std::swap(shell.triangles[t][1], shell.triangles[t][2]);
  return true;
}

void cut_intersections(Shell& shell, Notes& notes) {
  for (int round = 0; round < 3; ++round) {
    const auto pairs = intersecting_faces(shell, meshed(shell, half_edges(shell)));
    if (pairs.empty()) return;
    std::vector<char> bad(shell.triangles.size(), 0);
    for (const auto& [f, g] : pairs) bad[f] = bad[g] = 1;
    if (!is_damage(shell, bad)) return;
    cut_out(shell, bad, "that intersect", notes);
    drop_loose_parts(shell, notes);
  }
}

// ---- Openings

struct Rim {
  Mesh::Halfedge_index start;  // on the side of the opening
  std::vector<Vec3> points;
  Vec3 centre = Vec3::Zero(), outward = Vec3::UnitZ();
  double stray = 0;                    // mm, most from the plane
  double width = 0, breadth = 0;       // mm, in the plane
  std::vector<Mesh::Face_index> part;  // the faces of its part
};

Vec3 place_of(const Mesh& mesh, Mesh::Vertex_index v) {
  const Point& p = mesh.point(v);
  return {p.x(), p.y(), p.z()};
}

Rim rim_at(const Mesh& mesh, Mesh::Halfedge_index start) {
  Rim rim;
  rim.start = start;
  for (const auto h : CGAL::halfedges_around_face(start, mesh))
    rim.points.push_back(place_of(mesh, mesh.source(h)));
  const std::size_t n = rim.points.size();
  double length = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const Vec3 &a = rim.points[k], &b = rim.points[(k + 1) % n];
    rim.centre += 0.5 * (b - a).norm() * (a + b);
    length += (b - a).norm();
  }
  rim.centre /= length;
  Vec3 area = Vec3::Zero();
  Mat3 second = Mat3::Zero();
  for (std::size_t k = 0; k < n; ++k) {
    const Vec3 a = rim.points[k] - rim.centre, b = rim.points[(k + 1) % n] - rim.centre;
    area += a.cross(b);
    second += (b - a).norm() * a * a.transpose();
  }
  if (area.norm() > 0) rim.outward = area.normalized();
  const Eigen::SelfAdjointEigenSolver<Mat3> axes(second);
  for (int axis = 0; axis < 2; ++axis) {  // the two longest
    const Vec3 along = axes.eigenvectors().col(2 - axis);
    double low = 0, high = 0;
    for (const Vec3& p : rim.points) {
      low = std::min(low, along.dot(p - rim.centre));
      high = std::max(high, along.dot(p - rim.centre));
    }
    (axis == 0 ? rim.width : rim.breadth) = high - low;
  }
  for (const Vec3& p : rim.points)
    rim.stray = std::max(rim.stray, std::abs(rim.outward.dot(p - rim.centre)));
  return rim;
}

std::string size_at(const Rim& rim) {
  return fmt::format("{:.3g} x {:.2g} mm at {}", rim.width, rim.breadth, at(rim.centre));
}

// Why an opening can't be a crown's neck; empty if it can.
std::string no_neck(const Mesh& mesh, Rim& rim) {
  if (rim.stray > kMostStray * rim.width)
    return fmt::format("its rim strays {:.2g} mm from a plane", rim.stray);
  double area = 0, beyond = 0, below = 0, moment = 0, lowest = 0, highest = 0;
  for (const auto f : rim.part) {
    const auto v = corners(mesh, f);
    std::array<Vec3, 3> p;
    for (std::size_t k = 0; k < 3; ++k) p[k] = place_of(mesh, Mesh::Vertex_index(v[k]));
    const double own = 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).norm();
    const double height = rim.outward.dot((p[0] + p[1] + p[2]) / 3 - rim.centre);
    area += own;
    moment += own * height;
    if (std::abs(height) > rim.stray) (height > 0 ? beyond : below) += own;
    for (const Vec3& x : p) {
      const double here = rim.outward.dot(x - rim.centre);
      lowest = std::min(lowest, here);
      highest = std::max(highest, here);
    }
  }
  if (moment > 0) {  // its faces look inward
    rim.outward = -rim.outward;
    std::swap(beyond, below);
    lowest = -highest;
  }
  if (-lowest < kLeastHeight * rim.width)
    return fmt::format("the piece rises only {:.2g} mm above it", -lowest);
  if (beyond > kMostBeyond * area)
    return fmt::format("{:.0f} % of the piece lie beyond it", 100 * beyond / area);
  return {};
}

void fill_hole(Mesh& mesh, const Rim& rim, Notes& notes) {
  std::vector<Mesh::Face_index> faces;
  std::vector<Mesh::Vertex_index> points;
  pmp::triangulate_refine_and_fair_hole(mesh, rim.start, std::back_inserter(faces),
                                        std::back_inserter(points));
  if (faces.empty()) return;
  notes.push_back("filled a hole of " + size_at(rim) + " with " +
                  count_of(faces.size(), "face", "faces") +
                  (rim.width > 0.5 ? ", continuing the surface around it" : ""));
}

bool cap(Mesh& mesh, Mesh::Halfedge_index start, std::vector<Mesh::Face_index>& faces) {
  const std::size_t before = faces.size();
  pmp::triangulate_hole(mesh, start, std::back_inserter(faces),
                        CGAL::parameters::use_2d_constrained_delaunay_triangulation(true));
  return faces.size() > before;
}

// Walls from the rim along `outward` to a plane at `height` above the rim's centre; returns the rim
// of what is left open.
Mesh::Halfedge_index wall(Mesh& mesh, const Rim& rim, double height,
                          std::vector<Mesh::Face_index>& faces) {
  std::vector<Mesh::Halfedge_index> cycle;
  for (const auto h : CGAL::halfedges_around_face(rim.start, mesh)) cycle.push_back(h);
  std::vector<Mesh::Vertex_index> above(cycle.size());
  std::vector<std::array<Mesh::Vertex_index, 2>> ends;
  for (std::size_t k = 0; k < cycle.size(); ++k) {
    ends.push_back({mesh.source(cycle[k]), mesh.target(cycle[k])});
    const Vec3& p = rim.points[k];
    above[k] = mesh.add_vertex(cgal(p + (height - rim.outward.dot(p - rim.centre)) * rim.outward));
  }
  for (std::size_t k = 0; k < cycle.size(); ++k) {
    const auto next = above[(k + 1) % cycle.size()];
    faces.push_back(mesh.add_face(ends[k][0], ends[k][1], next));
    faces.push_back(mesh.add_face(ends[k][0], next, above[k]));
  }
  for (const auto f : faces)
    if (f == Mesh::null_face()) throw Error("a base can't be joined to the rim");
  return mesh.halfedge(above[0], above[1]);
}

// How an open side is closed, the best first.
enum class Base { kPlaneOrWalls, kMembrane };

std::string close_side(Mesh& mesh, const Rim& rim, double base_mm, Base how,
                       std::vector<Mesh::Face_index>& added) {
  const bool flat = rim.stray <= kFlatRim;
  if (how == Base::kMembrane || (flat && base_mm == 0)) {
    if (!cap(mesh, rim.start, added)) throw Error("its rim can't be spanned");
    return "closed the open side, " + size_at(rim) +
           (flat ? fmt::format(", by a plane (the rim strays {:.2g} mm from it)", rim.stray)
                 : std::string(", by the smallest surface across its rim"));
  }
  const double height = std::max(base_mm, flat ? 0 : kBelowRim) + rim.stray;
  if (!cap(mesh, wall(mesh, rim, height, added), added)) throw Error("its base can't be closed");
  return "closed the open side, " + size_at(rim) +
         fmt::format(", by a base of {:.2g} mm (the rim strays {:.2g} mm from a plane)", height,
                     rim.stray);
}

OpenSide open_side_of(const Rim& rim) {
  OpenSide side{rim.centre, rim.outward, rim.points, 0, 0};
  for (const Vec3& p : rim.points) {
    const double height = rim.outward.dot(p - rim.centre);
    side.lowest = std::min(side.lowest, height);
    side.highest = std::max(side.highest, height);
  }
  return side;
}

// ---- Back to a shell

// Merges the points of touching sheets. `is_added` by face.
SoundShell shell_of(const Mesh& mesh, const std::vector<Mesh::Face_index>& added,
                    const std::string& file) {
  SoundShell sound;
  Shell& shell = sound.shell;
  shell.file = file;
  std::vector<char> is_added(mesh.num_faces(), 0);
  for (const auto f : added) is_added[f] = 1;
  std::map<std::array<double, 3>, std::uint32_t> number;
  for (const auto f : mesh.faces()) {
    std::array<std::uint32_t, 3> triangle;
    const auto v = corners(mesh, f);
    for (std::size_t c = 0; c < 3; ++c) {
      const Point& p = mesh.point(Mesh::Vertex_index(v[c]));
      const auto [place, fresh] = number.try_emplace(
          {p.x(), p.y(), p.z()}, static_cast<std::uint32_t>(shell.points.size()));
      if (fresh) shell.points.emplace_back(p.x(), p.y(), p.z());
      triangle[c] = place->second;
    }
    shell.triangles.push_back(triangle);
    shell.face.push_back(static_cast<std::uint32_t>(shell.triangles.size()));
    sound.added.push_back(is_added[f]);
  }
  return sound;
}

// Faces whose corners lie on a line, which CGAL takes out by flips and collapses.
void remove_flat_faces(Shell& shell, Notes& notes) {
  Mesh mesh = meshed(shell, half_edges(shell)).mesh;
  std::size_t flat = 0;
  for (const auto f : mesh.faces())
    flat += static_cast<std::size_t>(pmp::is_degenerate_triangle_face(f, mesh));
  if (flat == 0) return;
  pmp::remove_degenerate_faces(mesh);
  mesh.collect_garbage();
  shell = shell_of(mesh, {}, shell.file).shell;
  notes.push_back("removed " + count_of(flat, "face", "faces") + " without area");
}

// Of a closed mesh without intersections. Returns how many faces were turned.
std::size_t turn_parts_outward(Mesh& mesh) {
  if (!CGAL::is_closed(mesh) || pmp::does_self_intersect<CGAL::Sequential_tag>(mesh)) return 0;
  const auto wrong = inside_out(mesh);
  if (!wrong.empty()) pmp::orient_to_bound_a_volume(mesh);
  return wrong.size();
}

[[noreturn]] void refuse(const std::string& file, const std::vector<std::string>& faults) {
  std::string all;
  for (const auto& fault : faults) all += (all.empty() ? "" : "; ") + fault;
  throw InputError(file, "", "does not bound a solid: " + all,
                   "closing it would invent a shape: mend it in a mesh program, or take one tooth "
                   "of it by --tooth or --roi");
}

// The rims of the openings that remain for a base, after small holes were filled; one per part.
std::vector<Rim> open_sides(Mesh& mesh, const std::string& file, Notes& notes) {
  std::vector<Mesh::Halfedge_index> starts;
  pmp::extract_boundary_cycles(mesh, std::back_inserter(starts));
  Box box{place_of(mesh, *mesh.vertices().begin()), place_of(mesh, *mesh.vertices().begin())};
  for (const auto v : mesh.vertices())
    box = {box.min.cwiseMin(place_of(mesh, v)), box.max.cwiseMax(place_of(mesh, v))};
  const double widest_hole = std::min(kWidestHole, kWidestShare * (box.max - box.min).maxCoeff());
  std::vector<Rim> wide;
  std::vector<std::string> faults;
  for (const auto start : starts) {
    Rim rim = rim_at(mesh, start);
    if (rim.width > widest_hole)
      wide.push_back(std::move(rim));
    else
      fill_hole(mesh, rim, notes);
  }
  std::vector<char> of_one(mesh.num_faces(), 0);
  for (Rim& rim : wide) {
    const auto inner = mesh.face(mesh.opposite(rim.start));
    pmp::connected_component(inner, mesh, std::back_inserter(rim.part));
    if (of_one[inner])
      faults.push_back("has a second opening, " + size_at(rim));
    else if (const std::string why = no_neck(mesh, rim); !why.empty())
      faults.push_back("has an opening, " + size_at(rim) + ", that is no neck: " + why);
    for (const auto f : rim.part) of_one[f] = 1;
  }
  if (!faults.empty()) refuse(file, faults);
  return wide;
}

}  // namespace

bool OpenSide::beyond(const Vec3& x) const {
  const double height = outward.dot(x - centre);
  if (height >= highest || height < lowest) return height >= highest;
  double nearest = std::numeric_limits<double>::infinity(), there = 0;
  for (const Vec3& p : rim) {
    const Vec3 to = x - p;
    const double up = outward.dot(to), square = to.squaredNorm() - up * up;
    if (square < nearest) {
      nearest = square;
      there = up;
    }
  }
  return there > 0;
}

SoundShell close_shell(Shell shell, double base_mm) {
  const std::string file = shell.file;
  if (std::vector<std::string> faults = shell_faults(shell); faults.empty())
    return {shell, std::vector<char>(shell.triangles.size(), 0), {}, {}};
  Notes notes;
  if (const std::size_t gone = remove_idle_faces(shell); gone > 0)
    notes.push_back("removed " + count_of(gone, "face", "faces") + " without area or given twice");
  join_seams(shell, notes);
  cut_crowded_edges(shell, notes);
  drop_loose_parts(shell, notes);
  if (shell.triangles.empty() || !turn_flipped(shell, notes)) refuse(file, shell_faults(shell));
  remove_flat_faces(shell, notes);
  cut_intersections(shell, notes);
  if (shell.triangles.empty()) refuse(file, {"no face with an area is left"});

  Mesh mesh = meshed(shell, half_edges(shell)).mesh;
  const std::vector<Rim> sides = open_sides(mesh, file, notes);
  std::vector<std::string> faults;
  for (const Base how : {Base::kPlaneOrWalls, Base::kMembrane}) {
    Mesh closed = mesh;
    std::vector<Mesh::Face_index> added;
    Notes done = notes;
    try {
      for (const Rim& rim : sides) done.push_back(close_side(closed, rim, base_mm, how, added));
    } catch (const InputError&) {
      throw;
    } catch (const Error& e) {
      faults = {e.what()};
      continue;
    }
    if (const std::size_t wrong = turn_parts_outward(closed); wrong > 0)
      done.push_back("turned " + count_of(wrong, "face", "faces") +
                     " of parts that were inside out");
    SoundShell sound = shell_of(closed, added, file);
    faults = shell_faults(sound.shell);
    if (faults.empty()) {
      for (const Rim& rim : sides) sound.open_sides.push_back(open_side_of(rim));
      sound.notes = std::move(done);
      return sound;
    }
    if (sides.empty()) break;
  }
  refuse(file, faults);
}

}  // namespace toothprep
