#include "sample_page.h"

#include <cmath>
#include <fstream>
#include <sstream>

namespace toothprep::testing {
namespace {

std::string file_bytes(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream bytes;
  bytes << in.rdbuf();
  return bytes.str();
}

// The crown of a molar from the side: two cusps, cut open at the neck.
Outline crown_outline(double half_width, double height) {
  Outline o;
  for (int i = 0; i <= 120; ++i) {
    const double t = -1 + i / 60.0;  // along the outline, side to side
    const double x = half_width * (std::abs(t) < 0.8 ? t / 0.8 : std::copysign(1.0, t)) *
                     (1 - 0.12 * std::pow(std::abs(t), 8));
    const double cusps = 1.1 * std::cos(t / 0.8 * 2 * 3.14159265) * -1;
    const double y = std::abs(t) < 0.8 ? height - 1.0 + 0.45 * cusps - 1.2 * std::pow(t / 0.8, 8)
                                       : (height - 2.65) * (1 - (std::abs(t) - 0.8) / 0.2);
    o.points.emplace_back(x, y);
  }
  return o;
}

Outline polygon(std::vector<Vec2> points, bool closed = true) {
  Outline o;
  o.points = std::move(points);
  o.closed = closed;
  return o;
}

Outline ellipse(double cx, double cy, double rx, double ry) {
  Outline o;
  o.closed = true;
  for (int i = 0; i < 60; ++i) {
    const double a = i * 2 * 3.14159265 / 60;
    o.points.emplace_back(cx + rx * std::cos(a), cy + ry * std::sin(a));
  }
  return o;
}

// The tooth's outline with a cavity cut from above: its corners from left to right.
Outline with_cavity(const Outline& tooth, const std::vector<Vec2>& cavity) {
  Outline o;
  bool cut = false;
  for (const Vec2& p : tooth.points) {
    if (p.x() > cavity.front().x() && p.x() < cavity.back().x() && p.y() > 3) {
      if (!cut) o.points.insert(o.points.end(), cavity.begin(), cavity.end());
      cut = true;
      continue;
    }
    o.points.push_back(p);
  }
  return o;
}

}  // namespace

ScorePage spoiled_class2() {
  ScorePage page;
  ScoreSheet& s = page.sheet;
  s.toothprep_version = "0.2.0";
  s.inputs = {
      {"original", "molar.vdb", "9f2c41d07be84aa1c3c0a54d9cbb6b07e0b1ac4f0f1f8b6d4b3d9a8a11223344"},
      {"prepared", "students/<script>alert(1)</script> & \"Müller\".vdb",
       "1b3c41d07be84aa1c3c0a54d9cbb6b07e0b1ac4f0f1f8b6d4b3d9a8a55667788"},
      {"target", "ideal-class2.vdb",
       "77ac41d07be84aa1c3c0a54d9cbb6b07e0b1ac4f0f1f8b6d4b3d9a8a99aabbcc"},
      {"trace", "session-12.h5",
       "c0ac41d07be84aa1c3c0a54d9cbb6b07e0b1ac4f0f1f8b6d4b3d9a8addeeff00"}};
  s.type = "class2";
  s.type_from = "given";
  s.axis = Vec3(0.0123, -0.0045, 0.9999);
  s.axis_from = "found";
  s.voxel_mm = 0.1;
  s.notes = {"the target was laid on the original: 0.021 mm RMS are left"};
  s.quantities = {{"removed_mm3.enamel", 21.42, 0.31, "mm^3"},
                  {"removed_mm3.dentin", 18.07, 0.27, "mm^3"},
                  {"removed_mm3.pulp", 0.062, 0.02, "mm^3"},
                  {"removed_mm3.other", 0, 0.001, "mm^3"},
                  {"removed_mm3.total", 39.55, 0.42, "mm^3"},
                  {"required_mm3", 34.1, 0.4, "mm^3"},
                  {"removed_inside_mm3", 32.9, 0.4, "mm^3"},
                  {"over_prepared_mm3", 6.65, 0.3, "mm^3"},
                  {"under_prepared_mm3", 1.2, 0.3, "mm^3"},
                  {"dice", 0.893, 0.01, "1"},
                  {"deviation_mean_mm", -0.083, 0.01, "mm"},
                  {"deviation_rms_mm", 0.142, 0.01, "mm"},
                  {"deviation_p95_mm", 0.31, 0.02, "mm"},
                  {"deviation_within_0_1mm", 0.553, 0.02, "1"},
                  {"deviation_within_0_2mm", 0.846, 0.02, "1"},
                  {"depth_mm", 2.31, 0.05, "mm"},
                  {"depth_min_mm", 1.66, 0.05, "mm"},
                  {"floor_flatness_mm", 0.031, 0.01, "mm"},
                  {"floor_tilt_deg", 12.3, 0.8, "deg"},
                  {"wall_angles_deg.buccal", 3.1, 2, "deg"},
                  {"wall_angles_deg.lingual", -13.4, 2, "deg"},
                  {"wall_angles_deg.distal", 5.0, 2, "deg"},
                  {"isthmus_width_mm", 1.62, 0.05, "mm"},
                  {"axial_depth_mm", 1.41, 0.05, "mm"},
                  {"gingival_floor_tilt_deg", 2.2, 1.5, "deg"},
                  {"undercut_max_mm", 0.44, 0.03, "mm"},
                  {"undercut_area_mm2", 2.6, 0.2, "mm^2"},
                  {"remaining_dentin_min_mm", 0, 0.05, "mm"},
                  {"pulp_exposed", 1, NAN, "yes/no"},
                  {"neighbour_damage_mm3", 0.012, 0.01, "mm^3"},
                  {"surface_roughness_mm", 0.021, 0.005, "mm"},
                  {"a_figure_that_the_table_lacks_mm", 1.5, NAN, "mm"}};

  // A recording: layers of cutting with rests between, a stall, the pulp touched at the end.
  std::vector<StepRecord> rows(30001);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    StepRecord& row = rows[i];
    const double t = static_cast<double>(i) * 1e-3 * 4, phase = std::fmod(t, 15.0);
    row.handle.time = t;
    row.handle.pose.position = row.bur.position = Vec3(0.3 * t, std::sin(t), 0);
    if (i > 0) row.removed_volume = rows[i - 1].removed_volume;
    if (phase < 3) continue;
    const double force = 0.9 + 0.5 * std::sin(1.7 * t) + 0.2 * std::sin(23 * t) + 0.006 * t;
    row.grinding_force = Vec3(0, force, 0.3);
    row.device_force = Vec3(0, 0.85 * force, 0.2);
    row.power = 350 * force;
    row.contact_area[0] = 1;
    row.removed_volume[0] += 1e-3;
    if (t > 61 && t < 63.5) {
      row.stalled = true;
      row.power = 0;
      row.device_force = row.grinding_force = Vec3(0, 2.5 + 0.8 * (t - 61), 0);
    }
    if (t > 112 && t < 114) row.contact_area[2] = 0.1;
    if (i == 20500) row.grinding_force = Vec3(0, 5.2, 0);  // a peak of a single row
  }
  const ProcessFigures process = process_figures(rows, {});
  s.quantities.insert(s.quantities.end(), process.quantities.begin(), process.quantities.end());
  page.trace = trace_plot(rows, process.events, {});
  s.result = judge(read_rubric(TOOTHPREP_SOURCE_DIR "/data/rubrics/class2.toml"), s.quantities);

  std::vector<double> deviation;
  for (int i = 0; i < 4000; ++i) {
    const double u = (i + 0.5) / 4000;
    deviation.push_back(-0.05 + 0.09 * std::log(u / (1 - u)) - (i % 5 == 0 ? 0.12 : 0));
  }
  page.deviation = deviation_histogram(deviation);

  Section across;
  across.name = "buccolingual";
  const Outline tooth = crown_outline(4.6, 7.5);
  across.original = {tooth};
  across.prepared = {with_cavity(
      tooth, {{-0.95, 6.0}, {-1.02, 4.75}, {-0.9, 4.62}, {1.2, 4.2}, {1.33, 4.33}, {0.95, 6.1}})};
  across.target = {polygon({{-0.8, 6.0}, {-0.85, 4.8}, {0.85, 4.8}, {0.8, 6.0}}, false)};
  across.dentin = {polygon(
      {{-3.4, 0}, {-3.7, 2.5}, {-2.6, 4.9}, {0, 4.9}, {2.6, 4.9}, {3.7, 2.5}, {3.4, 0}}, false)};
  across.pulp = {
      polygon({{-1.2, 0}, {-1.5, 2.4}, {-1.3, 3.3}, {0, 2.8}, {1.3, 4.25}, {1.5, 2.4}, {1.2, 0}})};
  across.marks = {{{-0.97, 5.7}, {-1.01, 4.85}, "3.1°", false},
                  {{1.02, 5.9}, {1.27, 4.6}, "-13.4°", false},
                  {{-0.8, 4.6}, {1.1, 4.22}, "12.3°", false},
                  {{-1.0, 5.3}, {1.13, 5.3}, "2.13 mm", true},
                  {{0.1, 4.43}, {0.1, 6.74}, "2.31 mm", true}};
  Section along = across;
  along.name = "mesiodistal";
  const Outline longer = crown_outline(5.3, 7.4);
  along.original = {longer};
  along.prepared = {with_cavity(longer, {{-2.6, 5.5},
                                         {-2.5, 4.55},
                                         {-2.4, 4.45},
                                         {3.1, 4.45},
                                         {3.3, 4.3},
                                         {3.4, 3.1},
                                         {3.5, 3.0},
                                         {5.4, 3.0}})};
  along.target.clear();
  along.pulp = {ellipse(0, 1.4, 2.2, 1.5)};
  along.marks = {{{-2.2, 4.45}, {2.9, 4.45}, "0.4°", false},
                 {{3.5, 3.4}, {5.0, 3.4}, "1.41 mm", true},
                 {{-2.5, 4.9}, {4.2, 4.9}, "6.72 mm", true},
                 {{-2.58, 5.3}, {-2.5, 4.6}, "5.0°", false}};
  page.sections = {across, along};
  const std::string png = file_bytes(TOOTHPREP_SOURCE_DIR "/data/pictures/class1-molar.png");
  page.pictures = {{"Before <original> & after", png}, {"Deviation from the target", png}};
  return page;
}

ScorePage good_crown() {
  ScorePage page;
  ScoreSheet& s = page.sheet;
  s.toothprep_version = "0.2.0";
  s.inputs = {{"original", "molar.vdb", "9f2c41d07be84aa1"},
              {"prepared", "crown.vdb", "1b3c41d07be8"}};
  s.type = "crown";
  s.type_from = "the rubric";
  s.quantities = {{"convergence_deg.buccolingual", 12.1, 1.1, "deg"},
                  {"convergence_deg.mesiodistal", 14.0, 1.1, "deg"},
                  {"convergence_deg.mean", 13.0, 0.8, "deg"},
                  {"wall_height_mm", 3.9, 0.05, "mm"},
                  {"occlusal_reduction_mm", 1.83, 0.05, "mm"},
                  {"occlusal_reduction_min_mm", 1.22, 0.05, "mm"},
                  {"margin_width_mm", 0.97, 0.05, "mm"},
                  {"margin_continuity", 1, NAN, "1"},
                  {"undercut_max_mm", 0, 0.03, "mm"},
                  {"remaining_dentin_min_mm", 1.7, 0.05, "mm"},
                  {"pulp_exposed", 0, NAN, "yes/no"}};
  s.result = judge(read_rubric(TOOTHPREP_SOURCE_DIR "/data/rubrics/crown.toml"), s.quantities);
  Section across;
  across.name = "buccolingual";
  across.original = {crown_outline(4.6, 7.5)};
  across.prepared = {polygon({{-4.5, 0},
                              {-4.5, 0.4},
                              {-3.5, 0.4},
                              {-3.1, 4.2},
                              {-2.6, 4.9},
                              {0, 4.2},
                              {2.6, 4.9},
                              {3.1, 4.2},
                              {3.5, 0.4},
                              {4.5, 0.4},
                              {4.5, 0}})};
  across.pulp = {ellipse(0, 1.4, 1.5, 1.2)};
  across.marks = {{{-3.4, 1.5}, {-3.23, 3.2}, "6.0°", false},
                  {{3.4, 1.5}, {3.23, 3.2}, "6.1°", false},
                  {{-4.5, 0.4}, {-3.5, 0.4}, "0.97 mm", true},
                  {{3.5, 0.4}, {4.5, 0.4}, "0.97 mm", true},
                  {{-3.9, 0.4}, {-3.9, 4.3}, "3.90 mm", true}};
  page.sections = {across};
  return page;
}

}  // namespace toothprep::testing
