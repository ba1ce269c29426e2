// The geometry of a preparation, measured on what the bur left: floors, walls, margin, reduction,
// undercut, remaining dentin.
//
// Frame. d is the occlusal axis, out of the tooth through the opening; u points mesially and v
// buccally, both across d. They are given, or recorded with the tooth, or found from the cut
// itself; heights are along d.
//
// The cut surface is the part of the prepared surface that lies deeper than a tolerance inside the
// original. Its facets are floors where the normal is within 45° of d, walls otherwise. Figures of
// a wall come from the middle third of its height, as the literature does with sections (Goodacre
// et al., J Prosthet Dent 2001;85:363-376): the rounded line angles at both ends don't count. An
// area-weighted mean of normals depends on a patch's rim only, so roughness doesn't tilt a wall.
//
// An axis that is known to some degrees only makes every angle to it, and every length along or
// across it, as uncertain: the axis's uncertainty u enters angles as it is, lengths by 1/cos(u) - 1.
//
// Every figure's exact definition stands with its key in tools/score/DEFINITIONS.md; uncertainties are
// D/2 for lengths and atan(D / height) for a wall's angle (D the voxel size), and of surfaces from labels
// of spacing L at least L and atan(L / height): that is what a scan or a segmentation
// allows, not the arithmetic: on exact surfaces the errors are far smaller (README.md).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/mesh/surface.h"
#include "toothprep/tools/preparation/quantity.h"
#include "toothprep/tools/preparation/section.h"

namespace toothprep {

enum class PreparationType { kCrown, kClass1, kClass2 };  // G. V. Black's classes
// Their names in files and options.
constexpr std::array<std::string_view, 3> kPreparationTypes = {"crown", "class1", "class2"};

struct PreparationOptions {                         // what is measured, and from where
  PreparationType type = PreparationType::kClass1;  // what figures there are
  // Directions in W, any length. What isn't given is read from the frame in the original's metadata
  // (recorded_frame()), or else found from the cut.
  std::optional<Vec3> occlusal, mesial, buccal;
  // An undercut shallower than this is ignored, mm. Scans and burs leave ripples that a bare test
  // of normals takes for undercuts.
  double undercut_threshold = 0.03;
  // How deep in the original the prepared surface counts as cut, mm; 0: a tenth of a voxel.
  double cut_tolerance = 0;
  // Spacing of the labels that a surface comes from, mm; 0: from none. Such a surface may lie half a
  // label off. What a bur cut here comes from none, whatever it was cut from.
  double cut_label_spacing = 0, original_label_spacing = 0;
  // 95 % half width of where a scan shows the cut surface, mm; 0: it comes from none.
  double cut_half_width = 0;
};

// What kind a cut is, judged by its walls and floors: a crown where most of the walls' area faces
// away from the tooth, a class II where two floors lie at different heights and the walls leave a
// side open, else a class I. Of `options` the directions are read. Throws as measure_preparation().
[[nodiscard]] PreparationType guess_type(const LayeredTooth& original, const LayeredTooth& prepared,
                                         const TriangleMesh& surface,
                                         const PreparationOptions& options);

struct PreparationFrame {      // the form's own directions
  Vec3 origin = Vec3::Zero();  // mm, W: the middle of the cut surface
  Vec3 u = Vec3::UnitX(), v = Vec3::UnitY(), d = Vec3::UnitZ();  // unit, W
  // Of d: "given", by the tooth's frame "recorded", "landmarks" or "estimated", or "found" in the cut
  std::string axis_source;
  double axis_uncertainty_deg = 0;  // of d: half width of the 95 % interval
  bool sides_known = false;         // u is mesial and v buccal, not just u and v

  bool axis_known() const { return axis_source != "found"; }  // from the tooth, not from the cut
  double along_u(const Vec3& x) const { return (x - origin).dot(u); }  // mm, of a place in W
  double along_v(const Vec3& x) const { return (x - origin).dot(v); }  // the same
  double height(const Vec3& x) const { return (x - origin).dot(d); }   // the same, along d
};

struct Preparation {                                      // all that was measured
  Quantities quantities;                                  // keys as in score.json
  std::vector<Section> sections;                          // for drawings
  std::vector<AbsentQuantity> absent;                     // not defined for this original
  std::vector<std::string> notes;                         // what a reader must know of the figures
  PreparationFrame frame;                                 // in which it was measured
  Vec3 path_of_draw = Vec3::UnitZ();                      // unit, W: the best path found
  std::vector<std::uint32_t> undercut_triangles;          // of the prepared surface given
  std::optional<Vec3> deepest_undercut, thinnest_dentin;  // mm, W: places
};

// Measures `prepared`, cut from `original` (same lattice). `surface` is prepared's, as
// extract_surface() gives it: facets of about a voxel. `target` is drawn in the sections only.
// Throws Error where there is nothing to measure: no cut surface of at least 30 facets, or none
// that is a wall or floor of the type asked for.
[[nodiscard]] Preparation measure_preparation(const LayeredTooth& original,
                                              const LayeredTooth& prepared,
                                              const TriangleMesh& surface,
                                              const PreparationOptions& options,
                                              const LayeredTooth* target = nullptr);

}  // namespace toothprep
