#include "toothprep/tools/preparation/frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/orientation/tooth_frame.h"
#include "toothprep/tools/preparation/floors.h"

namespace toothprep {
namespace {

Vec3 direction(const Vec3& given, const char* name) {
  if (!given.allFinite() || !(given.norm() > 1e-9))
    throw Error(std::string("the ") + name + " direction must be three finite numbers, not all 0");
  return given.normalized();
}

Vec3 across(const Vec3& x, const Vec3& d) { return x - x.dot(d) * d; }

// The part of `x` across d, unit; an error where they are within 5° of each other.
Vec3 sideways(const Vec3& x, const Vec3& d, const char* name) {
  const Vec3 flat = across(x, d);
  if (flat.norm() < 0.087)
    throw Error(std::string("the ") + name +
                " direction is parallel to the occlusal one; give a direction across it");
  return flat.normalized();
}

// Unit, or zero if no side was opened.
Vec3 mean_normal_cut_away(const TriangleMesh& surface, const std::vector<float>& height,
                          double tolerance) {
  Vec3 sum = Vec3::Zero();
  for (const auto& t : surface.triangles) {
    if (!(height[t[0]] > tolerance && height[t[1]] > tolerance && height[t[2]] > tolerance))
      continue;
    const Vec3 a = surface.vertices[t[0]].cast<double>();
    sum += (surface.vertices[t[1]].cast<double>() - a)
               .cross(surface.vertices[t[2]].cast<double>() - a);
  }
  return sum.norm() > 1e-9 ? Vec3(sum.normalized()) : Vec3(Vec3::Zero());
}

Vec3 along_the_walls(const CutFacets& facets, const Vec3& d) {
  const Vec3 a = d.unitOrthogonal(), b = d.cross(a);
  std::complex<double> sum = 0;
  for (const Facet& f : facets.all()) {
    if (std::abs(f.normal.dot(d)) > std::sqrt(0.5)) continue;
    const double angle = std::atan2(f.normal.dot(b), f.normal.dot(a));
    sum += f.area * std::polar(1.0, 4 * angle);
  }
  const double turn = std::arg(sum) / 4;
  Vec3 longest = a;
  double length = -1;
  for (int k = 0; k < 2; ++k) {
    const double t = turn + k * units::kPi / 2;
    const Vec3 u = std::cos(t) * a + std::sin(t) * b;
    double low = 1e30, high = -1e30;
    for (const Facet& f : facets.all()) {
      low = std::min(low, f.centroid.dot(u));
      high = std::max(high, f.centroid.dot(u));
    }
    if (high - low > length + 1e-9) {
      length = high - low;
      longest = u;
    }
  }
  return longest;
}

}  // namespace

namespace {

// An axis that only the cut tells of: preparations lean, and an opening on a slope leans with it.
constexpr double kFoundUncertainty = 20, kMostUncertain = 45;  // degrees

double degrees_between(const Vec3& a, const Vec3& b) {
  return units::to_degree(std::acos(std::clamp(a.dot(b), -1.0, 1.0)));
}

// d and how well it is known, from the cut alone.
void find_axis(PreparationFrame& frame, const Vec3& opening, const CutFacets& facets,
               PreparationType type, std::vector<std::string>& notes) {
  if (opening.isZero())
    throw Error(
        "no side of the tooth was opened, so its occlusal axis can't be found; give --axis "
        "X,Y,Z");
  frame.d = opening;
  frame.axis_source = "found";
  frame.axis_uncertainty_deg = kFoundUncertainty;
  const std::vector<Floor> floors = find_floors(facets, frame, 0.2);
  if (type == PreparationType::kClass2) {
    if (!floors.empty()) frame.d = floors[0].plane.normal(frame);
    notes.push_back(
        "the occlusal axis was taken from the largest floor, so its tilt says nothing; give "
        "--axis to judge it");
    return;
  }
  if (!floors.empty())
    frame.axis_uncertainty_deg =
        std::clamp(2 * degrees_between(floors[0].plane.normal(frame), opening), kFoundUncertainty,
                   kMostUncertain);
  notes.push_back(
      "the occlusal axis was found from the surface that was cut away; give --axis to judge "
      "angles against the tooth's own");
}

void find_sides(PreparationFrame& frame, const ToothFrame& tooth, const CutFacets& facets,
                const PreparationOptions& options, std::vector<std::string>& notes) {
  const auto side = [](const std::optional<Vec3>& given, const FrameAxis& recorded,
                       const char* name) -> std::optional<Vec3> {
    if (given) return direction(*given, name);
    return recorded.known() ? std::optional(recorded.direction) : std::nullopt;
  };
  const auto mesial = side(options.mesial, tooth.mesial, "mesial");
  const auto buccal = side(options.buccal, tooth.buccal, "buccal");
  frame.sides_known = mesial && buccal;
  if (mesial) {
    frame.u = sideways(*mesial, frame.d, "mesial");
    frame.v = frame.d.cross(frame.u);
    if (buccal) {
      const Vec3 out = sideways(*buccal, frame.d, "buccal");
      if (std::abs(out.dot(frame.u)) > 0.94)
        throw Error("the mesial and the buccal direction are parallel; give two across each other");
      if (out.dot(frame.v) < 0) frame.v = -frame.v;
    }
    if (buccal) return;
  } else {
    frame.u = along_the_walls(facets, frame.d);
    frame.v = frame.d.cross(frame.u);
    if (buccal) {
      frame.v = sideways(*buccal, frame.d, "buccal");
      frame.u = frame.v.cross(frame.d);
    }
  }
  if (mesial)
    notes.push_back(
        "which side is buccal isn't known, so walls are named u_plus (mesial), u_minus (distal), "
        "v_plus, v_minus; give --buccal X,Y,Z, or the tooth's number to toothprep orient");
  else if (buccal)
    notes.push_back(
        "which side is mesial isn't known, so walls are named u_plus, u_minus, v_plus (buccal), "
        "v_minus (lingual); give --mesial X,Y,Z, or the tooth's number to toothprep orient");
  else
    notes.push_back(
        "which side is mesial and which buccal isn't known, so walls are named u_plus, u_minus "
        "(along the form), v_plus, v_minus; give --mesial and --buccal X,Y,Z to name them");
}

}  // namespace

PreparationFrame find_frame(const LayeredTooth& original, const TriangleMesh& original_surface,
                            const std::vector<float>& height_above_prepared,
                            const CutFacets& facets, const PreparationOptions& options,
                            double tolerance, std::vector<std::string>& notes) {
  PreparationFrame frame;
  double area = 0;
  for (const Facet& f : facets.all()) {
    frame.origin += f.area * f.centroid;
    area += f.area;
  }
  frame.origin /= area;

  const Vec3 opening = mean_normal_cut_away(original_surface, height_above_prepared, tolerance);
  const ToothFrame tooth = recorded_frame(original.provenance);
  if (options.occlusal) {
    frame.d = direction(*options.occlusal, "occlusal");
    frame.axis_source = "given";
  } else if (tooth.occlusal.known()) {
    frame.d = tooth.occlusal.direction;
    frame.axis_uncertainty_deg = tooth.occlusal.uncertainty_deg;
    // What a person gave to `orient` is in the file now.
    frame.axis_source = tooth.occlusal.source == AxisSource::kGiven
                            ? "recorded"
                            : std::string(name_of(tooth.occlusal.source));
  } else {
    find_axis(frame, opening, facets, options.type, notes);
  }

  // A box that is open at the side, too, leans by 45 degrees and more, but nothing sound by 80.
  if (!opening.isZero() && opening.dot(frame.d) < std::cos(units::from_degree(80)))
    notes.push_back(
        fmt::format("the occlusal axis {} is {:.0f} degrees off the direction in which the tooth "
                    "was opened; is it right?",
                    frame.axis_source, degrees_between(opening, frame.d)));
  find_sides(frame, tooth, facets, options, notes);
  return frame;
}

}  // namespace toothprep
