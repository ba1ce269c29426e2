// Where a tooth is looked at from, and how large it is drawn. Always parallel rays: lengths across
// the picture are true, everywhere.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/mesh/surface.h"
#include "toothprep/tools/orientation/tooth_frame.h"

namespace toothprep {

// The directions of a tooth in W, unit and at right angles.
struct ToothAxes {
  Vec3 occlusal = Vec3::UnitZ();  // out of the mouth's bone
  Vec3 mesial = -Vec3::UnitY();   // along the arch to its middle
  Vec3 buccal = Vec3::UnitX();    // to the cheek
  bool occlusal_known = false, mesial_known = false, buccal_known = false;  // else made up
};

// From a tooth's frame, or from the one that its provenance holds. What isn't known is made up: the crown to +z; mesial to -y (or what lies nearest to it
// across the others). Throws Error for metadata that are no directions (recorded_frame()), and for
// axes that are parallel.
[[nodiscard]] ToothAxes axes_of_frame(const ToothFrame& frame);
[[nodiscard]] ToothAxes tooth_axes(const std::map<std::string, std::string>& provenance);

struct View {                       // from where a tooth is seen
  std::string name = "oblique";     // for reports
  Vec3 direction = -Vec3::UnitZ();  // from the eye into the picture, W; any length
  Vec3 up = Vec3::UnitY();          // upward in the picture, W; need not be square to `direction`
};

// The views by name: occlusal (buccal is up), apical, buccal, lingual, mesial, distal (the crown is
// up), oblique (from the mesial and buccal side, 35° above).
inline constexpr std::string_view kViewNames[] = {"oblique", "occlusal", "buccal", "lingual",
                                                  "mesial",  "distal",   "apical"};

// A name of kViewNames, or "X,Y,Z": from there towards the tooth. Throws Error otherwise.
[[nodiscard]] View view_of(const std::string& text, const ToothAxes& axes);

// The view turned about an axis (W) by radians, as if the tooth turned the other way.
[[nodiscard]] View turned(View view, const Vec3& axis, double angle);

// A camera for parallel rays. Pixel (0, 0) is at the top left; the centre of pixel (x, y) sees
// along `forward` from the point
//   origin + mm_per_pixel * ((x + 1/2 - width / 2) * right - (y + 1/2 - height / 2) * up).
// Depth is the distance from that plane, mm.
struct Camera {
  std::string view = "oblique";  // the view's name
  Vec3 origin = Vec3::Zero();    // mm, W; nothing that is drawn lies behind it
  Vec3 right = Vec3::UnitX(), up = Vec3::UnitY(), forward = -Vec3::UnitZ();  // unit, W
  int width = 0, height = 0;                                                 // pixels
  double mm_per_pixel = 1;                                                   // scale

  // Where the place `x`, `y` pixels from the top left corner lies, mm, W.
  [[nodiscard]] Vec3 place(double x, double y) const {
    return origin + mm_per_pixel * ((x - 0.5 * width) * right - (y - 0.5 * height) * up);
  }
};

struct Fit {                       // how large a picture, and of what
  int width = 1200, height = 900;  // pixels
  double margin = 0.06;            // of the picture, left free at each side
  double zoom = 1;                 // times what would fit
  std::optional<Vec3> centre;      // W: what stands in the middle; else that of the meshes' outline
  double mm_per_pixel = 0;         // if not 0: this, whatever would fit
};

// The camera in which all of the meshes' vertices are seen (unless zoomed).
// Throws Error for a picture that isn't 16 to 16384 pixels wide and high, more than 100 million
// pixels, a zoom that isn't positive and finite, a view without direction, or no vertices.
[[nodiscard]] Camera fit_camera(const View& view, const std::vector<const TriangleMesh*>& meshes,
                                const Fit& fit);

// What is in front of a plane is taken away: where (x - point) . normal > 0.
struct CutPlane {
  Vec3 point = Vec3::Zero();    // mm, W
  Vec3 normal = Vec3::UnitX();  // any length
};

// "X,Y,Z,NX,NY,NZ", or one of kViewNames but oblique: the plane through `middle` whose removed part
// lies to that side. Throws Error otherwise.
[[nodiscard]] CutPlane cut_of(const std::string& text, const ToothAxes& axes, const Vec3& middle);

// Straight at a cut, the crown up where it can be.
View view_at(const CutPlane& cut, const ToothAxes& axes, const std::string& name = "cut");

}  // namespace toothprep
