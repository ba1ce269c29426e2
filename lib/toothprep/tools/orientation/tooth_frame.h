// The tooth's own frame: where occlusal, mesial and buccal are, and how well that is known.
//
// It is kept in the tooth's metadata, so that every file made from the tooth has it:
//   frame_occlusal, frame_mesial, frame_buccal, frame_long    "x y z", unit, W; only what is known
//   frame_confidence    "occlusal 4.2 estimated; mesial not known; ...": half width of the 95 %
//                       interval in degrees, and where the direction comes from
//   frame_fossa_mm, frame_cusps_mm, frame_cervical_mm, frame_cervical_normal,
//   frame_occlusal_plane_mm, frame_occlusal_plane_normal      places "x y z", ';' between several
//   frame_form, frame_tooth_number                            "molar", FDI number
// Programs that don't know these keys pass them on. `axis_occlusal`, `axis_mesial`, `axis_buccal`
// are the exact directions of specimens; a frame in the file comes before them.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// Where a direction comes from.
enum class AxisSource { kNotKnown, kEstimated, kLandmarks, kRecorded, kGiven };
// "not known", "estimated" (from the tooth's form), "landmarks", "recorded" (with a specimen),
// "given" (by the user).
[[nodiscard]] std::string_view name_of(AxisSource source) noexcept;

struct FrameAxis {                                                // one direction of a tooth
  Vec3 direction = Vec3::Zero();                                  // unit, W; zero: not known
  double uncertainty_deg = 0;                                     // half width of the 95 % interval
  AxisSource source = AxisSource::kNotKnown;                      // where it comes from
  bool known() const { return source != AxisSource::kNotKnown; }  // whether there is one
};

struct FramePlane {             // of the neck, or of the cusps
  Vec3 point = Vec3::Zero();    // mm, W
  Vec3 normal = Vec3::UnitZ();  // unit, W, to the occlusal side
};

// By the crown's outline and cusps; kNotKnown where they don't fit any.
enum class CrownForm { kNotKnown, kIncisor, kPremolar, kMolar };
[[nodiscard]] std::string_view name_of(CrownForm form) noexcept;  // "molar", ..., "not known"

struct ToothFrame {                          // what is known of a tooth's directions and places
  FrameAxis occlusal;                        // out of the jaw, as the crown stands
  FrameAxis mesial, buccal;                  // across `occlusal`
  FrameAxis long_axis;                       // of crown and roots together, to the occlusal side
  std::optional<Vec3> fossa;                 // mm, W: the deepest place of the central fossa
  bool fossa_picked = false;                 // by a person, not found from the form
  std::vector<Vec3> cusps;                   // mm, W: the tips, highest first
  std::optional<FramePlane> cervical;        // plane of the enamel's lower border
  std::vector<Vec3> cervical_line;           // mm, W: places on it, around; not kept in files
  std::optional<FramePlane> occlusal_plane;  // on which the crown would stand upside down
  CrownForm form = CrownForm::kNotKnown;     // what kind of crown it is
  std::optional<int> tooth_number;           // FDI, where the user gave it
  std::vector<std::string> notes;            // why something is not known; not kept in files
};

// The frame that the metadata hold: empty, all not known, if they hold none. Throws Error for
// metadata that are no directions, zero, or parallel.
[[nodiscard]] ToothFrame recorded_frame(const std::map<std::string, std::string>& provenance);

// Puts the frame into the metadata, in place of any that is there.
void record_frame(const ToothFrame& frame, std::map<std::string, std::string>& provenance);

// "occlusal 0.03 -0.02 1.00 (+-4.2 degrees, estimated); mesial not known; buccal not known".
[[nodiscard]] std::string frame_text(const ToothFrame& frame);

}  // namespace toothprep
