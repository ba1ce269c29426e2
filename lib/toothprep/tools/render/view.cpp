#include "toothprep/tools/render/view.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

// Numbers between separators (and spaces); nothing if anything else stands there.
std::optional<std::vector<double>> numbers(std::string text, char separator) {
  std::replace(text.begin(), text.end(), separator, ' ');
  std::vector<double> values;
  const char *at = text.data(), *end = at + text.size();
  while (true) {
    while (at != end && *at == ' ') ++at;
    if (at == end) return values;
    double value = 0;
    const auto [next, fault] = std::from_chars(at, end, value);
    if (fault != std::errc() || !std::isfinite(value) || (next != end && *next != ' '))
      return std::nullopt;
    values.push_back(value);
    at = next;
  }
}

Vec3 direction_of(const std::vector<double>& v, std::size_t first, const std::string& what) {
  const Vec3 d(v[first], v[first + 1], v[first + 2]);
  if (d.stableNorm() == 0) throw Error(what + ": the direction is zero");
  return d.stableNormalized();
}

// The part of `axis` square to `to`, unit; nothing if they are (nearly) parallel.
std::optional<Vec3> squared(const Vec3& axis, const Vec3& to) {
  const Vec3 across = axis - axis.dot(to) * to;
  if (across.norm() < 0.02) return std::nullopt;
  return across.normalized();
}

Vec3 side(const std::string& name, const ToothAxes& axes) {
  if (name == "occlusal") return axes.occlusal;
  if (name == "apical") return -axes.occlusal;
  if (name == "mesial") return axes.mesial;
  if (name == "distal") return -axes.mesial;
  if (name == "buccal") return axes.buccal;
  if (name == "lingual") return -axes.buccal;
  return Vec3::Zero();
}

std::string name_list(std::size_t first) {
  std::string list;
  for (std::size_t i = first; i < std::size(kViewNames); ++i)
    list += (i > first ? ", " : "") + std::string(kViewNames[i]);
  return list;
}

}  // namespace

ToothAxes tooth_axes(const std::map<std::string, std::string>& provenance) {
  return axes_of_frame(recorded_frame(provenance));
}

ToothAxes axes_of_frame(const ToothFrame& frame) {
  const auto direction = [](const FrameAxis& axis) {
    return axis.known() ? std::optional(axis.direction) : std::nullopt;
  };
  const auto occlusal = direction(frame.occlusal), mesial = direction(frame.mesial),
             buccal = direction(frame.buccal);
  ToothAxes axes;
  if (occlusal)
    axes.occlusal = *occlusal;
  else if (mesial && buccal)
    axes.occlusal = mesial->cross(*buccal).normalized();
  if (!axes.occlusal.allFinite() || axes.occlusal.norm() < 0.5)
    throw Error("the mesial and the buccal direction are parallel");
  // Across the occlusal axis, mesial first; buccal keeps its side, whichever jaw it is of.
  std::optional<Vec3> across;
  if (mesial) {
    across = squared(*mesial, axes.occlusal);
    if (!across) throw Error("the mesial and the occlusal direction are parallel");
  } else if (buccal) {
    const auto square = squared(*buccal, axes.occlusal);
    if (!square) throw Error("the buccal and the occlusal direction are parallel");
    across = square->cross(axes.occlusal);
  } else {
    across = squared(-Vec3::UnitY(), axes.occlusal);
    if (!across) across = squared(Vec3::UnitX(), axes.occlusal);
  }
  axes.mesial = *across;
  axes.buccal = axes.occlusal.cross(axes.mesial);
  if (buccal && buccal->dot(axes.buccal) < 0) axes.buccal = -axes.buccal;
  axes.occlusal_known = occlusal || (mesial && buccal);
  axes.mesial_known = mesial.has_value();
  axes.buccal_known = buccal.has_value();
  return axes;
}

View view_of(const std::string& text, const ToothAxes& axes) {
  if (text == "oblique") {
    const Vec3 aside = (0.77 * axes.mesial + 0.64 * axes.buccal).normalized();
    const double above = units::from_degree(35);
    return {text, -(std::cos(above) * aside + std::sin(above) * axes.occlusal), axes.occlusal};
  }
  const Vec3 from = side(text, axes);
  if (from.norm() > 0) {
    const bool end_on = text == "occlusal" || text == "apical";
    return {text, -from, end_on ? axes.buccal : axes.occlusal};
  }
  const auto values = numbers(text, ',');
  if (!values || values->size() != 3)
    throw Error("view '" + text + "': give " + name_list(0) +
                ", or a direction X,Y,Z from which to look");
  const Vec3 place = direction_of(*values, 0, "view '" + text + "'");
  const bool end_on = std::abs(place.dot(axes.occlusal)) > 0.999;
  return {text, -place, end_on ? axes.buccal : axes.occlusal};
}

View turned(View view, const Vec3& axis, double angle) {
  const Eigen::AngleAxisd turn(angle, axis.normalized());
  view.direction = turn * view.direction;
  view.up = turn * view.up;
  return view;
}

Camera fit_camera(const View& view, const std::vector<const TriangleMesh*>& meshes,
                  const Fit& fit) {
  for (const int pixels : {fit.width, fit.height})
    if (pixels < 16 || pixels > 16384)
      throw Error("a picture of " + std::to_string(fit.width) + " x " + std::to_string(fit.height) +
                  " pixels: each side must lie in 16 to 16384");
  if (static_cast<double>(fit.width) * fit.height > 1e8)
    throw Error("a picture of " + std::to_string(fit.width) + " x " + std::to_string(fit.height) +
                " pixels: more than 100 million");
  if (!(fit.zoom > 0 && std::isfinite(fit.zoom))) throw Error("the zoom must be a positive number");
  if (!(view.direction.allFinite() && view.up.allFinite() && view.direction.stableNorm() > 0))
    throw Error("view '" + view.name + "' has no direction");
  if (fit.centre && !fit.centre->allFinite()) throw Error("the picture's centre is not finite");

  Camera camera;
  camera.view = view.name;
  camera.width = fit.width;
  camera.height = fit.height;
  camera.forward = view.direction.stableNormalized();
  Vec3 up = view.up.stableNormalized();
  if (!squared(up, camera.forward)) up = camera.forward.unitOrthogonal();
  camera.up = *squared(up, camera.forward);
  camera.right = camera.forward.cross(camera.up);

  Mat3 frame;
  frame << camera.right, camera.up, camera.forward;
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (const TriangleMesh* mesh : meshes)
    for (const auto& v : mesh->vertices) {
      const Vec3 x = frame.transpose() * v.cast<double>();
      low = low.cwiseMin(x);
      high = high.cwiseMax(x);
    }
  if (!(low.array() <= high.array()).all()) throw Error("there is nothing to draw");
  const double free = 1 - 2 * fit.margin;
  const Vec3 size = high - low;
  Vec3 middle = 0.5 * (low + high);
  if (fit.centre) middle.head<2>() = (frame.transpose() * *fit.centre).head<2>();
  const Vec3 half = (high - middle).cwiseMax(middle - low);
  camera.mm_per_pixel = 2 * std::max(half.x() / (free * fit.width), half.y() / (free * fit.height));
  if (!(camera.mm_per_pixel > 0)) camera.mm_per_pixel = 1;  // a line seen end-on
  if (fit.mm_per_pixel > 0) camera.mm_per_pixel = fit.mm_per_pixel;
  camera.mm_per_pixel /= fit.zoom;
  // As far away as the meshes are long, so that turning doesn't bring anything behind the camera.
  middle.z() = std::min(low.z(), 0.5 * (low.z() + high.z()) - size.norm());
  camera.origin = frame * middle;
  return camera;
}

CutPlane cut_of(const std::string& text, const ToothAxes& axes, const Vec3& middle) {
  const Vec3 normal = side(text, axes);
  if (normal.norm() > 0) return {middle, normal};
  const auto values = numbers(text, ',');
  if (!values || values->size() != 6)
    throw Error("cut '" + text + "': give " + name_list(1) +
                " (that side is removed), or a point and a direction X,Y,Z,NX,NY,NZ");
  return {Vec3((*values)[0], (*values)[1], (*values)[2]),
          direction_of(*values, 3, "cut '" + text + "'")};
}

View view_at(const CutPlane& cut, const ToothAxes& axes, const std::string& name) {
  const Vec3& n = cut.normal;
  const bool along_crown = std::abs(n.dot(axes.occlusal)) > 0.999 * n.norm();
  return {name, -n, along_crown ? axes.buccal : axes.occlusal};
}

}  // namespace toothprep
