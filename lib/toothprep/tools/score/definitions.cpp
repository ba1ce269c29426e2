#include "toothprep/tools/score/definitions.h"

#include <fmt/format.h>

#include <cmath>

#include "toothprep/step/core/number_text.h"

namespace toothprep {
namespace {

constexpr const char* kGoodacre = "Goodacre et al., J Prosthet Dent 2001;85:363-376";
constexpr const char* kSturdevant = "Class I and II preparation as taught after Sturdevant";
constexpr const char* kClass2 = "1.25-1.5 mm on molars (Class II laboratory sheets)";
constexpr const char* kCompare =
    "the measure of Compare (E4D); a tolerance of 0.2 mm separated depths of 1.0, 1.5 and 2.0 mm";
constexpr const char* kSae = "as in Sci Rep 2023;13:11847 (computational geometry of preparations)";
constexpr const char* kRecording = "the recording, by its rows";
constexpr const char* kBuilt = "by construction";
constexpr const char* kAnyContact =
    "any contact counts as damage: Medeiros and Seddon, J Dent 2000";
// In place of a member's name: whatever the tooth file calls it.
constexpr const char* kAnyName = "NAME";

// A row without its section.
struct Row {
  std::string key;
  std::vector<std::string> members;
  std::string unit, name, definition, source;
};

using Names = std::vector<std::string>;
using Rows = std::vector<Row>;

Names with(Names names, const std::string& name) {
  names.push_back(name);
  return names;
}

const Names kSingle;  // not a group
const Names kBodies = {kAnyName};
const Names kTissues = {"enamel", "dentin", "pulp", "other"};
// u and v: where mesial and buccal aren't known.
const Names kSides = {"mesial", "distal",  "buccal", "lingual",
                      "u_plus", "u_minus", "v_plus", "v_minus"};

Names walls() {
  Names names = with(kSides, "axial");
  for (const std::string& side : kSides) names.push_back("proximal_" + side);
  return names;
}

Rows volume_rows() {
  return {
      {"removed_mm3", with(kTissues, "total"), "mm^3", "removed volume",
       "Volume that the original tooth has and the prepared one has not, per tissue of the "
       "original and in all; by partial voxels. Of a tooth file with a list of bodies `total` is "
       "of "
       "the prepared tooth, `other` of the rest.",
       kBuilt},
      {"required_mm3", kSingle, "mm^3", "volume to be removed",
       "Volume that the original tooth has and the target has not.", kBuilt},
      {"removed_inside_mm3", kSingle, "mm^3", "removed where it should be",
       "The part of the removed volume that was to be removed.", kBuilt},
      {"over_prepared_mm3", kSingle, "mm^3", "over-prepared volume",
       "The part of the removed volume that the target keeps.", kBuilt},
      {"over_prepared_by_tissue_mm3", kTissues, "mm^3", "over-prepared volume",
       "The over-prepared volume, per tissue of the original.", kBuilt},
      {"under_prepared_mm3", kSingle, "mm^3", "under-prepared volume",
       "The volume that was to be removed and is still there.", kBuilt},
      {"dice", kSingle, "1", "overlap with the target (Dice)",
       "2 R/(removed + to be removed), R = what was removed of what was to be "
       "removed: 1 when both are the same, 0 when they have nothing in common.",
       "Dice, Ecology 1945;26:297-302"},
      {"neighbour_damage_mm3", kSingle, "mm^3", "damage to the neighbouring tooth",
       "Volume removed of what the tooth file calls `other` (a neighbouring tooth); where the file "
       "has a list of bodies, of all neighbours in it.",
       kAnyContact},
      {"neighbour_depth_mm", kSingle, "mm", "depth of the damage to neighbouring teeth",
       "Largest distance from the prepared surface to the original one within a neighbour; needs a "
       "list of bodies.",
       kAnyContact},
      {"gum_damage_mm3", kSingle, "mm^3", "damage to the gum",
       "Volume removed of the bodies that the tooth file calls gum.", kBuilt},
      {"gum_depth_mm", kSingle, "mm", "depth of the damage to the gum",
       "As of neighbouring teeth, within the gum.", kBuilt},
      {"body_removed_mm3", kBodies, "mm^3", "removed of a body that isn't to be touched",
       "Volume removed of each neighbour, and gum, in the tooth file's list of bodies, by its "
       "name.",
       kAnyContact},
      {"body_depth_mm", kBodies, "mm", "depth of the damage to a body",
       "Largest distance from the prepared surface to the original one within it.", kAnyContact},
  };
}

Rows deviation_rows() {
  return {
      {"deviation_mean_mm", kSingle, "mm", "mean deviation from the target",
       "Mean, by area, of the signed distance from the prepared surface to the target's, where "
       "either was cut: positive where material was left, negative where too much was taken.",
       kBuilt},
      {"deviation_rms_mm", kSingle, "mm", "RMS deviation",
       "Root of the mean square, by area, of that distance.", kBuilt},
      {"deviation_p95_mm", kSingle, "mm", "95 % deviation",
       "The distance that 95 % of that area do not exceed.", kBuilt},
      {"hausdorff_mm", kSingle, "mm", "largest deviation (Hausdorff)",
       "The larger of the largest distance from the prepared surface to the target's and the "
       "largest one back, where either was cut.",
       "Hausdorff distance, as in Cignoni et al., Comput Graph Forum 1998;17:167-174"},
      {"deviation_within_0_1mm", kSingle, "1", "share within 0.1 mm",
       "Share of that area that lies within 0.1 mm of the target's surface.", kCompare},
      {"deviation_within_0_2mm", kSingle, "1", "share within 0.2 mm",
       "Share of that area that lies within 0.2 mm of the target's surface.", kCompare},
      {"registration_rms_mm", kSingle, "mm", "registration residual",
       "RMS distance between the unprepared surfaces of both teeth after they were laid on each "
       "other. What it leaves adds to every other figure.",
       kBuilt},
  };
}

Rows cavity_rows() {
  return {
      {"depth_mm", kSingle, "mm", "cavity depth",
       "Median distance, along the occlusal axis, from the (pulpal) floor up to the original "
       "surface.",
       kSturdevant},
      {"depth_min_mm", kSingle, "mm", "least depth",
       "The 5 % value of the distance from the floor up to the original surface.", kBuilt},
      {"depth_max_mm", kSingle, "mm", "largest depth",
       "The 95 % value of the distance from the floor up to the original surface.", kBuilt},
      {"floor_flatness_mm", kSingle, "mm", "floor flatness",
       "RMS distance of the floor, away from its line angles, from its best plane.", kBuilt},
      {"floor_tilt_deg", kSingle, "deg", "floor tilt",
       "Angle between the normal of the floor's best plane and the occlusal axis.", kBuilt},
      {"wall_angles_deg", walls(), "deg", "wall angle",
       "Angle of the wall, over the middle third of its height, to the occlusal axis: positive "
       "when the wall faces the opening, so that the form draws; negative when it is undercut. "
       "Where the tooth's sides aren't known: u and v. Of a box: axial, and proximal walls.",
       kSae},
      {"convergence_deg",
       {"buccolingual", "mesiodistal", "mean", "proximal"},
       "deg",
       "total occlusal convergence",
       "Angle between opposing walls, the sum of both walls' angles to the axis: positive when "
       "they converge toward the occlusal surface (a crown's stump), negative for a cavity that "
       "opens. Proximal: of the side walls of a box.",
       kGoodacre},
      {"wall_height_mm", kSingle, "mm", "wall height",
       "Median height of the walls along the axis, from the floor or margin at their foot to the "
       "edge above.",
       kGoodacre},
      {"width_mm", kSingle, "mm", "width",
       "Buccolingual extent of the cavity at half its depth (98 % of the walls' area lie within "
       "it).",
       kBuilt},
      {"isthmus_width_mm", kSingle, "mm", "isthmus width",
       "Smallest buccolingual width of the cavity along its length, at half its depth, in slices "
       "of two voxels.",
       kSturdevant},
      {"length_mm", kSingle, "mm", "length",
       "Mesiodistal extent of the cavity at half its depth (98 % of the walls' area lie within "
       "it).",
       kBuilt},
      {"marginal_ridge_mm",
       {"mesial", "distal", "u_plus", "u_minus"},
       "mm",
       "width of the marginal ridge",
       "The lower quartile, over the upper third of the wall on that side, of the distance "
       "straight out "
       "to the original proximal surface, which faces up by less than 45 degrees. Where the "
       "tooth's "
       "sides aren't known: u, along the form.",
       kSturdevant},
      {"wall_thickness_min_mm", kSingle, "mm", "least thickness of the remaining walls",
       "The 2 % value, over the middle third of all walls' height, of the distance across the axis "
       "from the wall through what remains to the tooth's outside.",
       kBuilt},
      {"breakthrough", kSingle, "yes/no", "breakthrough to the side",
       "Of class I: whether more than 1 mm of the cavity's outline lies where the original surface "
       "is within 10 degrees of parallel to the occlusal axis.",
       kBuilt},
  };
}

Rows box_rows() {
  return {
      {"gingival_depth_mm", kSingle, "mm", "depth of the gingival floor",
       "Median distance, along the occlusal axis, from the gingival floor of the box up to the "
       "original surface.",
       kBuilt},
      {"gingival_floor_flatness_mm", kSingle, "mm", "flatness of the gingival floor",
       "RMS distance of the gingival floor, away from its line angles, from its best plane.",
       kBuilt},
      {"gingival_floor_tilt_deg", kSingle, "deg", "tilt of the gingival floor",
       "Angle between the normal of the gingival floor's best plane and the occlusal axis.",
       kBuilt},
      {"axial_depth_mm", kSingle, "mm", "axial depth of the box",
       "Median distance from the axial wall, over the middle third of its height, out to the "
       "original proximal surface.",
       kClass2},
      {"axial_wall_height_mm", kSingle, "mm", "height of the axial wall",
       "Height of the pulpal floor's plane above the middle of the gingival floor, along the axis.",
       kBuilt},
      {"box_width_mm", kSingle, "mm", "width of the box",
       "Distance between the proximal walls of the box at the middle of their height.", kBuilt},
      {"box_width_floor_mm", kSingle, "mm", "width of the box at its floor",
       "The same at the level of the gingival floor.", kBuilt},
      {"gingival_floor_width_mm", kSingle, "mm", "width of the gingival floor",
       "Median distance from the axial wall, extended down to the gingival floor, out to the "
       "original proximal surface.",
       kBuilt},
      {"axiopulpal_radius_mm", kSingle, "mm", "radius of the axiopulpal edge",
       "Median radius of the arc between the axial wall, extended up, and the pulpal floor, as "
       "that "
       "of the occlusoaxial edge of a crown.",
       "the axiopulpal line angle is rounded or bevelled (Class II preparation texts)"},
      {"box_clearance_mm", kSingle, "mm", "clearance of the box",
       "Smallest distance from the box's outline below the pulpal floor to the neighbouring tooth; "
       "only where the tooth file has one.",
       "the box clears the neighbour by 0.5 mm (Class II preparation texts)"},
  };
}

Rows crown_rows() {
  return {
      {"margin_width_mm", kSingle, "mm", "margin width",
       "Median, along the finish line, of the distance across the axis to the axial wall extended "
       "down to it: of a shoulder, a chamfer and a bevel alike.",
       "Dental Advisor; guide of IPS e.max"},
      {"margin_width_min_mm", kSingle, "mm", "least margin width",
       "The 5 % value, along the finish line, of the margin's width.", kBuilt},
      {"margin_width_max_mm", kSingle, "mm", "largest margin width",
       "The 95 % value, along the finish line, of the margin's width.", kBuilt},
      {"margin_continuity", kSingle, "1", "continuity of the margin",
       "Share of the circumference, in steps of 5 degrees, where the margin is wider than 0.2 mm.",
       kBuilt},
      {"margin_gaps", kSingle, "count", "gaps of the margin",
       "How often, around the walls, the finish line is missing or its margin no wider than 0.2 "
       "mm; "
       "gaps of less than 0.2 mm or two voxels don't count.",
       kBuilt},
      {"margin_gap_deg", kSingle, "deg", "angle of the margin's gaps",
       "Angle about the middle of the walls that those gaps take in all.", kBuilt},
      {"margin_gap_longest_mm", kSingle, "mm", "longest gap of the margin",
       "Length around of the longest of them: its angle times the finish line's mean distance "
       "from the middle at its ends.",
       kBuilt},
      {"margin_form",
       {"shoulder", "chamfer", "bevel", "feather_edge", "irregular"},
       "1",
       "form of the margin",
       "Share of the finish line, in steps of 5 degrees, by the profile of the margin in an "
       "upright "
       "plane across: wall, ledge and an arc between them are fitted. A chamfer where the arc "
       "takes "
       "more than half of the ledge; else a bevel where the ledge falls outwards by more than 30 "
       "degrees, or a shoulder. A feather edge where the margin is no wider than 0.2 mm; irregular "
       "where the fit misses by more than half a voxel and 0.05 mm.",
       kBuilt},
      {"cavosurface_angle_deg", kSingle, "deg", "cavosurface angle of the margin",
       "Median, along the finish line, of the angle in the tooth between the ledge where it ends "
       "and "
       "the uncut surface: 90 degrees for a square shoulder, more for a chamfer or a bevel.",
       kBuilt},
      {"occlusoaxial_radius_mm", kSingle, "mm", "radius of the occlusoaxial edge",
       "Median, around the stump, of the radius of the arc between the axial wall, extended up, "
       "and "
       "the occlusal surface within 1 mm of it, fitted in an upright plane.",
       "rounded line angles: Goodacre et al. 2001"},
      {"occlusoaxial_radius_min_mm", kSingle, "mm", "least radius of the occlusoaxial edge",
       "The 5 % value of that radius.", kBuilt},
      {"occlusoaxial_angle_deg", kSingle, "deg", "angle of the occlusoaxial edge",
       "Median of the angle, in the tooth, between the axial wall and the occlusal surface beside "
       "it.",
       kBuilt},
      {"occlusoaxial_sharp", kSingle, "1", "sharp share of the occlusoaxial edge",
       "Share of the circumference with a radius below 0.15 mm.", kBuilt},
      {"finish_line_roughness_mm", kSingle, "mm", "roughness of the finish line",
       "RMS distance of the finish line from the quadratic curve fitted to what lies within 0.75 "
       "mm "
       "along it: the course is taken out, notches and waves of up to 1 mm stay.",
       kBuilt},
      {"occlusal_reduction_mm", kSingle, "mm", "occlusal reduction",
       "Median distance, along the occlusal axis, from the stump's occlusal surface up to the "
       "original one.",
       kGoodacre},
      {"occlusal_reduction_min_mm", kSingle, "mm", "least occlusal reduction",
       "The 5 % value of the distance from the stump's occlusal surface up to the original one.",
       kBuilt},
      {"axial_reduction_mm", kSides, "mm", "axial reduction",
       "Median distance, across the axis, from the axial wall out to the original surface, on that "
       "side, over the middle third of the wall's height.",
       kBuilt},
      {"axial_reduction_min_mm", kSingle, "mm", "least axial reduction",
       "The 5 % value of that distance over all sides.", kBuilt},
  };
}

Rows surface_rows() {
  return {
      {"undercut_max_mm", kSingle, "mm", "deepest undercut",
       "Along the best path of draw: how far, across the path, the deepest place lies behind what "
       "stands above it, as much as would have to be blocked out. Below the threshold (0.03 mm "
       "unless set otherwise) there is none.",
       "raw facets over-report: roughness of scans was flagged as undercut on 25 of 26 teeth "
       "(prepCheck, poster of the Harvard School of Dental Medicine)"},
      {"undercut_area_mm2", kSingle, "mm^2", "undercut area",
       "Area of the cut surface that is undercut along the best path of draw by more than the "
       "threshold.",
       kBuilt},
      {"undercut_along_axis_mm", kSingle, "mm", "deepest undercut along the axis",
       "The same along the occlusal axis instead of the best path of draw.", kBuilt},
      {"path_of_draw_tilt_deg", kSingle, "deg", "tilt of the path of draw",
       "Angle between the path along which the form draws best and the occlusal axis.", kBuilt},
      {"remaining_dentin_min_mm", kSingle, "mm", "remaining dentin",
       "Smallest distance from the cut surface to the pulp.",
       "at least 2 mm ideal, 0.5 mm to avoid irreversible damage: IJBTE (UBT) 6(2)"},
      {"pulp_exposed", kSingle, "yes/no", "pulp exposed",
       "Whether the cut reaches into the pulp by more than what the voxel size leaves open.",
       kBuilt},
      {"surface_roughness_mm", kSingle, "mm", "surface roughness",
       "RMS distance of the cut surface from the quadratic surface fitted to what lies within 0.4 "
       "mm, away from line angles: form is taken out, marks of the bur stay.",
       kBuilt},
      {"line_angle_radius_mm", kSingle, "mm", "radius of the line angles",
       "Median radius of the rounding between the walls and the floor at their foot; of a crown, "
       "of "
       "the arc between axial wall and margin.",
       "rounded line angles: Goodacre et al. 2001"},
  };
}

Rows process_rows() {
  return {
      {"process.time_s", kSingle, "s", "time", "From the recording's first row to its last.",
       kRecording},
      {"process.contact_time_s", kSingle, "s", "time in contact",
       "Time of the steps in contact: the bur advances into tissue, or removes some.", kRecording},
      {"process.cutting_time_s", kSingle, "s", "cutting time",
       "Time of the steps in contact in which the bur is not stalled.", kRecording},
      {"process.path_mm", kSingle, "mm", "path of the bur",
       "Length of the way of the bur's tip, step by step.", kRecording},
      {"process.path_cutting_mm", kSingle, "mm", "path while cutting",
       "The part of the path that was made in cutting steps.", kRecording},
      {"process.mean_speed_mm_s", kSingle, "mm/s", "mean speed", "Path over time.", kRecording},
      {"process.mean_feed_mm_s", kSingle, "mm/s", "mean feed",
       "Path while cutting over cutting time.", kRecording},
      {"process.peak_force_n", kSingle, "N", "peak force",
       "Largest grinding force on the bur in contact.", kRecording},
      {"process.force_p95_n", kSingle, "N", "95 % force",
       "The grinding force that is not exceeded in 95 % of the time in contact.", kRecording},
      {"process.peak_device_force_n", kSingle, "N", "peak force felt",
       "Largest force that the operator felt while the bur was in contact.", kRecording},
      {"process.device_force_p95_n", kSingle, "N", "95 % force felt",
       "The force felt by the operator that is not exceeded in 95 % of the time in contact.",
       kRecording},
      {"process.time_above_force_limit_s", kSingle, "s", "time above the force limit",
       "Time in contact with a grinding force above the limit (2 N unless set otherwise).",
       "the limit is a convention"},
      {"process.mean_power_w", kSingle, "W", "mean grinding power",
       "Energy over cutting time. Nearly all of it heats the tooth, the chips and the water.",
       kRecording},
      {"process.peak_power_w", kSingle, "W", "peak grinding power", "Largest grinding power.",
       kRecording},
      {"process.time_above_power_limit_s", kSingle, "s", "time above the power limit",
       "Time with a grinding power above the limit (1 W unless set otherwise): heating, and "
       "only for comparison, since the cooling is not modelled.",
       "the limit is a convention"},
      {"process.energy_j", kSingle, "J", "grinding energy", "The grinding power, summed over time.",
       kRecording},
      {"process.stalls", kSingle, "count", "stalls", "How often the bur began to stall.",
       kRecording},
      {"process.stalled_time_s", kSingle, "s", "stalled time", "Time of the stalled steps.",
       kRecording},
      {"process.pulp_contact_s", kSingle, "s", "contact with the pulp",
       "Time in which the bur advanced into the pulp or removed some.", kRecording},
      {"process.neighbour_contact_s", kSingle, "s", "contact with the neighbouring tooth",
       "Time in which the bur advanced into what the tooth file calls `other`, or removed "
       "some; where the file has a list of bodies, into a neighbour.",
       kAnyContact},
      {"process.body_contact_s", kBodies, "s", "contact with a body that isn't to be touched",
       "Time in which the bur advanced into each neighbour, and gum, in the tooth file's list of "
       "bodies.",
       kAnyContact},
      {"process.gum_contact_s", kSingle, "s", "contact with the gum",
       "Time in which the bur advanced into a body that the tooth file calls gum.", kRecording},
      {"process.max_lag_mm", kSingle, "mm", "largest lag",
       "Largest distance between the handle and the bur that hangs on it.", kRecording},
      {"process.removal_rate_mm3_s", kSingle, "mm^3/s", "removal rate",
       "Removed volume over cutting time: efficiency.", kRecording},
      {"process.contact_episodes", kSingle, "count", "contact episodes",
       "How often the bur came into contact; interruptions below 0.1 s don't count.", kRecording},
  };
}

std::vector<QuantityDefinition> make_table() {
  const std::pair<const char*, Rows> sections[] = {{"Volumes", volume_rows()},
                                                   {"Deviation from the target", deviation_rows()},
                                                   {"Floor, walls, widths", cavity_rows()},
                                                   {"Proximal box", box_rows()},
                                                   {"Crown", crown_rows()},
                                                   {"Path of draw, pulp, surface", surface_rows()},
                                                   {"Process", process_rows()}};
  std::vector<QuantityDefinition> table;
  for (const auto& [section, rows] : sections)
    for (const Row& r : rows)
      table.push_back({section, r.key, r.members, r.unit, r.name, r.definition, r.source});
  return table;
}

// The row and, of a group, the member.
std::pair<const QuantityDefinition*, std::string> find_row(const std::string& key) {
  for (const QuantityDefinition& row : quantity_definitions()) {
    if (row.members.empty()) {
      if (row.key == key) return {&row, {}};
      continue;
    }
    for (const std::string& member : row.members)
      if (row.key + "." + member == key) return {&row, member};
    const std::string group = row.key + ".";
    if (row.members[0] == kAnyName && key.size() > group.size() && key.rfind(group, 0) == 0)
      return {&row, key.substr(group.size())};
  }
  return {nullptr, {}};
}

std::string unit_text(const std::string& unit) {
  if (unit == "deg") return "°";
  if (unit == "1" || unit == "count" || unit == "yes/no") return "";
  std::string text = " " + unit;
  for (const auto& [from, to] : {std::pair("^2", "²"), std::pair("^3", "³")})
    if (const std::size_t at = text.find(from); at != std::string::npos) text.replace(at, 2, to);
  return text;
}

int digits_of(const std::string& unit) {
  if (unit == "deg" || unit == "s") return 1;
  if (unit == "count") return 0;
  if (unit == "1") return 3;
  return 2;
}

}  // namespace

const std::vector<QuantityDefinition>& quantity_definitions() {
  static const std::vector<QuantityDefinition> table = make_table();
  return table;
}

const QuantityDefinition* find_definition(const std::string& key) { return find_row(key).first; }

std::string quantity_name(const std::string& key) {
  const auto [row, member] = find_row(key);
  if (!row) return key;
  if (member.empty()) return row->name;
  std::string words = member;  // "proximal_buccal", but u_plus as the notes write it
  if (const auto at = words.find('_'); at != std::string::npos && at > 1) words[at] = ' ';
  return row->name + " (" + words + ")";
}

std::vector<std::string> known_quantity_keys() {
  std::vector<std::string> keys;
  for (const QuantityDefinition& row : quantity_definitions()) {
    if (row.members.empty()) keys.push_back(row.key);
    for (const std::string& member : row.members) keys.push_back(row.key + "." + member);
  }
  return keys;
}

std::vector<std::string> known_criterion_keys() {
  std::vector<std::string> keys = known_quantity_keys();
  for (const QuantityDefinition& row : quantity_definitions())
    if (!row.members.empty()) keys.push_back(row.key + ".*");
  return keys;
}

std::string value_text(double value, const std::string& unit, std::optional<int> digits) {
  if (unit == "yes/no") return value != 0 ? "yes" : "no";
  return without_negative_zero(fmt::format("{:.{}f}", value, digits.value_or(digits_of(unit)))) +
         unit_text(unit);
}

std::string definitions_page() {
  std::string page =
      "# What the figures of a score mean\n\n"
      "This page is made from the table in `definitions.cpp`. Keys are those of `score.json`, "
      "where "
      "a dot makes a group.\n";
  std::string section;
  for (const QuantityDefinition& row : quantity_definitions()) {
    if (row.section != section) {
      section = row.section;
      page += "\n## " + section + "\n\n";
      if (section == "Process")
        page +=
            "From a recording: a row stands for the step that ends at its time. The bur is in "
            "*contact* while its advancing\ncontact area is above 0 or tissue is removed, and "
            "*cutting* while in contact and not stalled.\n\n";
      page += "| key | unit | definition | source |\n|---|---|---|---|\n";
    }
    std::string members;
    for (const std::string& member : row.members) members += (members.empty() ? "" : ", ") + member;
    page += "| `" + row.key + (members.empty() ? "" : ".{" + members + "}") + "` | " + row.unit +
            " | *" + row.name + "*: " + row.definition + " | " + row.source + " |\n";
  }
  return page;
}

}  // namespace toothprep
