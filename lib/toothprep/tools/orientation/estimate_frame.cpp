#include "toothprep/tools/orientation/estimate_frame.h"

#include <fmt/format.h>

#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/tooth/tooth_bodies.h"
#include "toothprep/tools/orientation/crown_form.h"
#include "toothprep/tools/orientation/label_block.h"
#include "toothprep/tools/orientation/occlusal_axis.h"

namespace toothprep {
namespace {

constexpr int kCells = 110;  // along the longest edge: finer changes nothing in 0.5°

void check_number(int number) {
  const int quadrant = number / 10, place = number % 10;
  const int most = quadrant <= 4 ? 8 : 5;
  if (quadrant < 1 || quadrant > 8 || place < 1 || place > most)
    throw Error(
        fmt::format("{} is no tooth number of FDI (11 to 48, of children 51 to 85)", number));
}

FrameAxis checked(FrameAxis axis, const char* name) {
  if (!axis.known()) return axis;
  if (!axis.direction.allFinite() || axis.direction.stableNorm() == 0)
    throw Error(std::string("the ") + name + " direction must be three finite numbers, not all 0");
  axis.direction.stableNormalize();
  return axis;
}

// Across the occlusal direction, whose own uncertainty tilts it as much.
FrameAxis squared(FrameAxis axis, const FrameAxis& occlusal, const char* name) {
  if (!axis.known() || !occlusal.known()) return axis;
  const Vec3& d = occlusal.direction;
  const Vec3 flat = axis.direction - axis.direction.dot(d) * d;
  if (flat.norm() < 0.17)
    throw Error(std::string("the ") + name +
                " direction is within 10 degrees of the occlusal one; give one across it");
  axis.direction = flat.normalized();
  return axis;
}

// buccal = hand * occlusal x mesial.
std::optional<double> hand_of(const std::optional<int>& number) {
  if (!number) return {};
  return (*number / 10) % 2 == 1 ? 1.0 : -1.0;
}

void find_sides(ToothFrame& frame, const KnownAxes& known) {
  frame.mesial = squared(checked(known.mesial, "mesial"), frame.occlusal, "mesial");
  frame.buccal = squared(checked(known.buccal, "buccal"), frame.occlusal, "buccal");
  const auto hand = hand_of(frame.tooth_number);
  const bool both = frame.mesial.known() && frame.buccal.known();
  if (both && std::abs(frame.mesial.direction.dot(frame.buccal.direction)) > 0.94)
    throw Error("the mesial and the buccal direction are parallel; give two across each other");
  if (!frame.occlusal.known() || !hand) return;
  const Vec3& d = frame.occlusal.direction;
  if (both && frame.buccal.direction.dot(*hand * d.cross(frame.mesial.direction)) < 0)
    throw Error(fmt::format(
        "of tooth {} buccal lies on the other side of mesial, seen from occlusal: one of the "
        "directions or the number is wrong",
        *frame.tooth_number));
  if (frame.mesial.known() && !frame.buccal.known()) {
    frame.buccal = frame.mesial;
    frame.buccal.direction = *hand * d.cross(frame.mesial.direction);
  } else if (frame.buccal.known() && !frame.mesial.known()) {
    frame.mesial = frame.buccal;
    frame.mesial.direction = *hand * frame.buccal.direction.cross(d);
  }
}

void check_form(ToothFrame& frame) {
  if (!frame.tooth_number || frame.form == CrownForm::kNotKnown) return;
  const int place = *frame.tooth_number % 10;
  const bool molar = place >= 6 || (*frame.tooth_number > 50 && place >= 4);
  const bool premolar = !molar && place >= 4;
  const bool fits = molar      ? frame.form == CrownForm::kMolar
                    : premolar ? frame.form == CrownForm::kPremolar
                               : frame.form == CrownForm::kIncisor;
  if (!fits)
    frame.notes.push_back(fmt::format("the crown has the form of {} {}, which tooth {} isn't",
                                      frame.form == CrownForm::kIncisor ? "an" : "a",
                                      name_of(frame.form), *frame.tooth_number));
}

}  // namespace

ToothFrame estimate_frame(const LayeredTooth& tooth, const KnownAxes& known) {
  if (tooth.bodies) return estimate_frame(with_others_as_other(tooth), known);
  ToothFrame frame;
  frame.tooth_number = known.tooth_number;
  if (frame.tooth_number) check_number(*frame.tooth_number);
  const LabelBlock block = label_block(tooth, kCells);
  const FrameAxis said = checked(known.occlusal, "occlusal");
  OcclusalAxis axis =
      find_occlusal_axis(block, said.known() ? std::optional(said.direction) : std::nullopt);
  frame.occlusal = said.known() ? said : axis.occlusal;
  frame.long_axis = axis.long_axis;
  frame.cervical = axis.cervical;
  frame.cervical_line = std::move(axis.cervical_line);
  frame.occlusal_plane = axis.occlusal_plane;
  frame.notes = std::move(axis.notes);
  find_sides(frame, known);
  if (!frame.occlusal.known()) return frame;
  const Vec3& d = frame.occlusal.direction;
  const auto neck =
      frame.cervical ? std::optional(frame.cervical->point.dot(d)) : std::optional<double>();
  const Crown crown = describe_crown(block, d, neck);
  frame.cusps = crown.cusps;
  frame.fossa = known.fossa ? known.fossa : crown.fossa;
  frame.fossa_picked = known.fossa.has_value();
  frame.form = crown.form;
  check_form(frame);
  return frame;
}

KnownAxes known_axes(const ToothFrame& recorded) {
  KnownAxes known;
  const auto keep = [](const FrameAxis& axis) {
    return axis.source == AxisSource::kEstimated ? FrameAxis{} : axis;
  };
  known.occlusal = keep(recorded.occlusal);
  known.mesial = keep(recorded.mesial);
  known.buccal = keep(recorded.buccal);
  if (recorded.fossa_picked) known.fossa = recorded.fossa;
  known.tooth_number = recorded.tooth_number;
  return known;
}

KnownAxes both(const KnownAxes& first, KnownAxes second) {
  const auto take = [](const FrameAxis& from, FrameAxis& axis) {
    if (from.known()) axis = from;
  };
  take(first.occlusal, second.occlusal);
  take(first.mesial, second.mesial);
  take(first.buccal, second.buccal);
  if (first.fossa) second.fossa = first.fossa;
  if (first.tooth_number) second.tooth_number = first.tooth_number;
  return second;
}

}  // namespace toothprep
