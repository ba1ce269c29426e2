#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <variant>

#include "toothprep/step/core/strict_toml.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/trajectory/path_frame.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {
namespace {

constexpr double kLongest = 24 * 3600.0;      // s
constexpr std::size_t kMostPoints = 1000000;  // of a polyline
constexpr double kNothing = 1e-9;             // mm: shorter is no distance
// A sample this part of a step short of the end is the end: the sum of the durations rounds.
constexpr double kSameSample = 1e-6;

// A motion along a curve, by the time since its start. Position only: the bur turns independently.
struct Hold {
  Vec3 at;
};
struct Line {  // s(t) = speed t + acceleration t²/2 along `direction`
  Vec3 from, direction;
  double speed, acceleration;
};
struct Arc {
  Vec3 center, normal, radius;  // center: foot on the axis; radius: from there to the start
  double rate;                  // rad/s, signed
};
struct Polyline {
  std::vector<Vec3> points;
  std::vector<double> arrival;  // time at each point, s
};
using Path = std::variant<Hold, Line, Arc, Polyline>;

struct Position {
  double time;

  Vec3 operator()(const Hold& hold) const { return hold.at; }
  Vec3 operator()(const Line& line) const {
    return line.from + line.direction * (line.speed * time + 0.5 * line.acceleration * time * time);
  }
  Vec3 operator()(const Arc& arc) const {
    return arc.center + Eigen::AngleAxisd(arc.rate * time, arc.normal) * arc.radius;
  }
  Vec3 operator()(const Polyline& line) const {
    const auto after = std::upper_bound(line.arrival.begin(), line.arrival.end(), time);
    if (after == line.arrival.end()) return line.points.back();
    const std::size_t i = static_cast<std::size_t>(after - line.arrival.begin());
    const double fraction = (time - line.arrival[i - 1]) / (line.arrival[i] - line.arrival[i - 1]);
    return line.points[i - 1] + fraction * (line.points[i] - line.points[i - 1]);
  }
};

struct Segment {
  Path path;
  double duration = 0;          // s
  Pose from, to;                // to.position is exact, whatever the path's rounding
  Quat arc = Quat::Identity();  // takes the axis at the start to that at the end (W frame)
  double spin = 0;              // rad, about the bur's own axis, over the segment
  bool pedal = true;

  Pose at(double time) const {
    if (time >= duration) return to;
    const double fraction = time / duration;
    Pose pose{std::visit(Position{time}, path), from.orientation};
    if (turns())
      pose.orientation = (Quat::Identity().slerp(fraction, arc) * from.orientation *
                          Quat(Eigen::AngleAxisd(fraction * spin, Vec3::UnitZ())))
                             .normalized();
    return pose;
  }
  bool turns() const { return spin != 0 || arc.coeffs() != Quat::Identity().coeffs(); }
};

double require_positive(StrictTable& table, const std::string& key, const std::string& example) {
  const auto value = table.number(key);
  if (!value) table.missing(key, example);
  if (!(*value > 0 && std::isfinite(*value))) table.refuse(key, "must be positive and finite");
  return *value;
}
double positive_or(StrictTable& table, const std::string& key, double otherwise) {
  return table.has(key) ? require_positive(table, key, "") : otherwise;
}
double finite_or(StrictTable& table, const std::string& key, double otherwise) {
  const double value = table.number(key).value_or(otherwise);
  if (!std::isfinite(value)) table.refuse(key, "must be finite");
  return value;
}
Vec3 require_vector(StrictTable& table, const std::string& key) {
  const auto value = table.vector(key);
  if (!value) table.missing(key, "[x, y, z]");
  return *value;
}
// A direction of any length, made a unit vector.
Vec3 direction(StrictTable& table, const std::string& key, const Vec3& value) {
  const double length = value.stableNorm();
  if (!(length > 1e-12)) table.refuse(key, "must not be zero");
  return value / length;
}

// Straight legs at one speed each; `speeds[i]` leads to points[i + 1]. Legs of no length are
// dropped.
Polyline polyline(const std::vector<Vec3>& points, const std::vector<double>& speeds) {
  Polyline line;
  line.points = {points.front()};
  line.arrival = {0.0};
  for (std::size_t i = 1; i < points.size(); ++i) {
    const double length = (points[i] - line.points.back()).norm();
    if (length <= kNothing) continue;
    line.points.push_back(points[i]);
    line.arrival.push_back(line.arrival.back() + length / speeds[i - 1]);
  }
  return line;
}

void read_line(StrictTable& table, Segment& segment) {
  const Vec3 to = require_vector(table, "to_mm");
  const Vec3 way = to - segment.from.position;
  const double length = way.norm();
  if (!(length > kNothing))
    table.refuse("to_mm", "is where the bur already is", "use kind = \"hold\" to wait or turn");
  Line line{segment.from.position, way / length, 0.0, 0.0};
  if (table.has("acceleration_mm_s2")) {
    line.acceleration = finite_or(table, "acceleration_mm_s2", 0.0);
    line.speed = table.number("speed_mm_s").value_or(0.0);
    if (!(line.speed >= 0 && std::isfinite(line.speed)))
      table.refuse("speed_mm_s", "must be finite and not negative beside acceleration_mm_s2");
    if (line.acceleration == 0)
      table.refuse("acceleration_mm_s2", "must not be 0", "give speed_mm_s alone");
    const double end_speed_squared = line.speed * line.speed + 2.0 * line.acceleration * length;
    if (end_speed_squared < 0)
      table.refuse("acceleration_mm_s2",
                   fmt::format("stops the bur after {:g} of {:g} mm",
                               -0.5 * line.speed * line.speed / line.acceleration, length),
                   "brake less, or start faster");
    // The root of s = v t + a t²/2 in the form that does not cancel.
    segment.duration = 2.0 * length / (line.speed + std::sqrt(end_speed_squared));
  } else {
    line.speed = require_positive(table, "speed_mm_s", "0.5");
    segment.duration = length / line.speed;
  }
  segment.to.position = to;
  segment.path = line;
}

void read_arc(StrictTable& table, Segment& segment) {
  const Vec3 center = require_vector(table, "center_mm");
  const Vec3 normal = direction(table, "normal", require_vector(table, "normal"));
  const auto angle_deg = table.number("angle_deg");
  if (!angle_deg) table.missing("angle_deg", "90");
  if (!std::isfinite(*angle_deg) || *angle_deg == 0)
    table.refuse("angle_deg", "must be finite and not 0");
  const double speed = require_positive(table, "speed_mm_s", "0.5");
  const Vec3 arm = segment.from.position - center;
  const Vec3 radius = arm - normal.dot(arm) * normal;
  const double r = radius.norm();
  if (!(r > kNothing))
    table.refuse("center_mm", "the bur stands on the arc's axis", "an arc needs a radius");
  const double angle = units::from_degree(*angle_deg);
  const Arc arc{segment.from.position - radius, normal, radius, std::copysign(speed / r, angle)};
  segment.duration = std::abs(angle) * r / speed;
  segment.to.position = arc.center + Eigen::AngleAxisd(angle, normal) * radius;
  segment.path = arc;
}

void read_waypoints(StrictTable& table, Segment& segment) {
  const auto points = table.vectors("points_mm");
  if (!points) table.missing("points_mm", "[[0, 0, 0], [1, 0, 0]]");
  if (points->empty()) table.refuse("points_mm", "is empty");
  const double speed = require_positive(table, "speed_mm_s", "0.5");
  std::vector<Vec3> all = {segment.from.position};
  all.insert(all.end(), points->begin(), points->end());
  Polyline line = polyline(all, std::vector<double>(points->size(), speed));
  if (line.points.size() < 2)
    table.refuse("points_mm", "is where the bur already is", "use kind = \"hold\" to wait or turn");
  segment.duration = line.arrival.back();
  segment.to.position = line.points.back();
  segment.path = std::move(line);
}

void read_lattice(StrictTable& table, Segment& segment) {
  const Vec3 origin = require_vector(table, "origin_mm");
  const Vec3 u = require_vector(table, "u_mm");
  const Vec3 v = require_vector(table, "v_mm");
  const double step = require_positive(table, "step_mm", "0.3");
  const double speed = require_positive(table, "speed_mm_s", "0.5");
  const double plunge_speed = positive_or(table, "plunge_speed_mm_s", speed);
  const std::int64_t layers = table.integer("layers").value_or(1);
  if (layers < 1) table.refuse("layers", "must be 1 or more");
  const double depth = finite_or(table, "layer_depth_mm", 0.0);
  if (depth < 0) table.refuse("layer_depth_mm", "must not be negative");
  if (depth == 0 && layers > 1)
    table.refuse("layer_depth_mm", "must be positive where there are several layers");
  if (!(u.norm() > kNothing)) table.refuse("u_mm", "must not be zero");
  if (!(v.norm() > kNothing)) table.refuse("v_mm", "must not be zero");
  if (!(u.normalized().cross(v.normalized()).norm() > 1e-6))
    table.refuse("v_mm", "is parallel to u_mm", "two edges of a pocket are needed");
  // A step that divides the edge up to rounding is kept.
  const double gaps = std::max(1.0, std::ceil(v.norm() / step - 1e-9));
  if (!((gaps + 1.0) * 2.0 * static_cast<double>(layers) < static_cast<double>(kMostPoints)))
    table.refuse("step_mm", "makes more than a million passes in all", "mill in coarser steps");

  const auto intervals = static_cast<std::int64_t>(gaps);
  const Vec3 down = -(segment.from.orientation * Vec3::UnitZ());
  std::vector<Vec3> points = {segment.from.position, origin};
  std::vector<double> speeds = {speed};
  // The corner of the pocket where the bur is: 0 or 1, 0 or intervals.
  std::int64_t side = 0, row = 0;
  const auto corner = [&](std::int64_t layer) {
    return origin + static_cast<double>(layer) * depth * down + static_cast<double>(side) * u +
           (static_cast<double>(row) / gaps) * v;
  };
  for (std::int64_t layer = 1; layer <= layers; ++layer) {
    points.push_back(corner(layer));
    speeds.push_back(plunge_speed);
    const std::int64_t onward = row == 0 ? 1 : -1;
    for (std::int64_t pass = 0; pass <= intervals; ++pass) {
      if (pass > 0) {
        row += onward;
        points.push_back(corner(layer));
        speeds.push_back(speed);
      }
      side = 1 - side;
      points.push_back(corner(layer));
      speeds.push_back(speed);
    }
  }
  Polyline line = polyline(points, speeds);
  segment.duration = line.arrival.back();
  segment.to.position = line.points.back();
  segment.path = std::move(line);
}

Segment read_segment(StrictTable& table, const Pose& start) {
  Segment segment;
  segment.from = segment.to = start;
  const auto kind = table.choice("kind", {"line", "hold", "arc", "waypoints", "lattice"});
  if (!kind) table.missing("kind", "\"line\"");
  if (*kind == "line") read_line(table, segment);
  if (*kind == "arc") read_arc(table, segment);
  if (*kind == "waypoints") read_waypoints(table, segment);
  if (*kind == "lattice") read_lattice(table, segment);
  if (*kind == "hold") {
    segment.duration = require_positive(table, "duration_s", "1.0");
    segment.path = Hold{start.position};
  }
  if (const auto given = table.vector("axis")) {
    const Vec3 to = direction(table, "axis", *given);
    const Vec3 from = start.orientation * Vec3::UnitZ();
    if (from.dot(to) < -1.0 + 1e-9)
      table.refuse("axis",
                   "is opposite to the bur's present axis, so no way to turn is the shortest",
                   "turn in two segments");
    if ((to - from).norm() > 1e-12) segment.arc = Quat::FromTwoVectors(from, to);
  }
  segment.spin = units::from_degree(finite_or(table, "spin_deg", 0.0));
  segment.pedal = table.boolean("pedal").value_or(true);
  if (segment.turns())
    segment.to.orientation =
        (segment.arc * start.orientation * Quat(Eigen::AngleAxisd(segment.spin, Vec3::UnitZ())))
            .normalized();
  table.done();
  return segment;
}

}  // namespace

Trajectory parse_script(const std::string& toml, const std::string& where, PathFrame& frame) {
  const toml::table document = parse_toml(toml, where);
  StrictTable root(document, where);
  const bool own = root.choice("frame", {"file", "tooth"}).value_or("file") == "tooth";
  frame = own ? PathFrame::kTooth : PathFrame::kFile;
  Pose pose;
  pose.position = require_vector(root, "start_mm");
  const Vec3 axis = direction(root, "axis", root.vector("axis").value_or(Vec3(Vec3::UnitZ())));
  const double spin = units::from_degree(finite_or(root, "spin_deg", 0.0));
  pose.orientation = orientation_of_axis(axis, spin);
  const double rate = positive_or(root, "rate_hz", 1000.0);
  auto tables = root.tables("segment");
  root.done();
  if (!tables || tables->empty())
    throw InputError(where, "segment", "is missing", "add [[segment]] tables");

  std::vector<Segment> segments;
  std::vector<double> start = {0.0};  // of each segment and of what follows the last, s
  for (StrictTable& table : *tables) {
    segments.push_back(read_segment(table, pose));
    pose = segments.back().to;
    start.push_back(start.back() + segments.back().duration);
    if (!(start.back() <= kLongest))
      throw InputError(where, "segment[" + std::to_string(segments.size() - 1) + "]",
                       "ends later than 24 h after the start", "check lengths and speeds");
  }

  const double steps = std::ceil(start.back() * rate - kSameSample);
  if (!(steps < static_cast<double>(kMostSamples)))
    throw InputError(where, "rate_hz",
                     "makes more than " + std::to_string(kMostSamples) + " samples of " +
                         std::to_string(start.back()) + " s",
                     "lower it, or cut the script into pieces");
  const auto last = static_cast<std::size_t>(std::max(steps, 1.0));  // a motion has two samples

  Trajectory trajectory;
  trajectory.samples.reserve(last + 1);
  std::size_t s = 0;
  for (std::size_t i = 0; i <= last; ++i) {
    HandleSample sample;
    sample.time = static_cast<double>(i) / rate;
    while (s + 1 < segments.size() && sample.time >= start[s + 1]) ++s;
    sample.pose = i == last ? pose : segments[s].at(sample.time - start[s]);
    sample.buttons = segments[i == last ? segments.size() - 1 : s].pedal ? kPedalButton : 0u;
    trajectory.samples.push_back(sample);
  }
  return trajectory;
}

Trajectory read_script(const std::string& path, PathFrame& frame) {
  return parse_script(read_small_text(path), path, frame);
}

Trajectory parse_script(const std::string& toml, const std::string& where) {
  PathFrame frame = PathFrame::kFile;
  Trajectory path = parse_script(toml, where, frame);
  if (frame == PathFrame::kTooth)
    throw InputError(where, "frame",
                     "the path is written in the tooth's own frame, which isn't known here",
                     "place it on a tooth first, with toothprep place");
  return path;
}

Trajectory read_script(const std::string& path) {
  return parse_script(read_small_text(path), path);
}

}  // namespace toothprep
