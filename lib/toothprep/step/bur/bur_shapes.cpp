#include "toothprep/step/bur/bur_shapes.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <optional>
#include <sstream>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

using Outline = std::vector<ProfilePiece>;
using units::kPi;

// The values given, by letter; absent ones are not in the map.
class Values {
 public:
  Values(std::string spec, std::map<char, double> values)
      : spec_(std::move(spec)), values_(std::move(values)) {}

  bool has(char letter) const { return values_.count(letter) != 0; }
  double operator[](char letter) const { return values_.at(letter); }
  double get(char letter, double otherwise) const {
    const auto found = values_.find(letter);
    return found == values_.end() ? otherwise : found->second;
  }
  void require(bool holds, const std::string& condition, const std::string& remedy = {}) const {
    if (!holds) throw InputError("--bur " + spec_, "", condition, remedy);
  }

 private:
  std::string spec_;
  std::map<char, double> values_;
};

struct Letter {
  char letter;
  const char* meaning;
  double least, most;
};

// Sizes below 0.05 mm are taken for a slip in the unit.
constexpr Letter kLetters[] = {
    {'D', "largest head diameter, mm", 0.05, 10},
    {'L', "head length, mm", 0.05, 50},
    {'T', "tip diameter, mm", 0, 10},
    {'A', "flank angle, degrees per side", 0, 60},
    {'R', "corner radius, mm", 0, 5},
    {'N', "diameter at the head's shank end, mm", 0.05, 10},
    {'B', "height of the largest diameter over the tip, mm", 0.025, 50},
    {'S', "neck diameter, mm", 0, 10},
};

const Letter& letter_of(char letter) {
  return *std::find_if(std::begin(kLetters), std::end(kLetters),
                       [&](const Letter& l) { return l.letter == letter; });
}

std::string short_text(double value) { return fmt::format("{:g}", value); }

// ---- Outlines. All close with a disc at the shank's end, which doesn't grind.

void close_head(Outline& outline) {
  const double r = outline.back().r1, z = outline.back().z1;
  if (r > 0) outline.push_back(line_piece(r, z, 0, z, false));
}

// A tip of a flat disc of radius `flat`, a corner of radius `corner` about (flat, corner) that
// leaves it tangentially, and from there the tangent to (end, length).
Outline tip_and_flank(double flat, double corner, double end, double length) {
  Outline outline;
  if (flat > 0) outline.push_back(line_piece(0, 0, flat, 0));
  // Outward normal (cos a, -sin a) of the flank, a > 0 where the head widens upwards: its line lies
  // at distance `corner` from the corner's centre and passes through (end, length).
  const double across = end - flat, up = length - corner;
  double a =
      std::acos(std::clamp(corner / std::hypot(across, up), -1.0, 1.0)) - std::atan2(up, across);
  if (std::abs(a) < 1e-12) a = 0;
  double r = flat, z = 0;
  if (corner > 0) {
    r = flat + corner * std::cos(a);
    z = corner - corner * std::sin(a);
    outline.push_back(arc_piece(flat, 0, r, z, flat, corner));
  }
  if (std::hypot(end - r, length - z) > 1e-6) outline.push_back(line_piece(r, z, end, length));
  close_head(outline);
  return outline;
}

// From the tip, blunted by a sphere of radius `blunt`, by an arc to (radius, height) with a
// vertical tangent.
Outline ogive(double radius, double height, double blunt) {
  // The arc has its centre at the height of its end; it passes through the tip or touches the
  // sphere inside.
  const double rho = (radius * radius + (height - blunt) * (height - blunt) - blunt * blunt) /
                     (2 * (radius - blunt));
  const double centre_r = radius - rho;
  Outline outline;
  double r = 0, z = 0;
  if (blunt > 0) {
    const double away = std::hypot(centre_r, blunt - height);
    r = -blunt * centre_r / away;
    z = blunt + blunt * (blunt - height) / away;
    outline.push_back(arc_piece(0, 0, r, z, 0, blunt));
  }
  outline.push_back(arc_piece(r, z, radius, height, centre_r, height));
  return outline;
}

Outline ball(const Values& v) { return {arc_piece(0, 0, 0, v['D'], 0, v['D'] / 2)}; }

Outline cylinder(const Values& v) {
  const double radius = v['D'] / 2, corner = v.get('R', 0);
  v.require(corner <= radius,
            "R (" + short_text(corner) + ") must not exceed D/2 (" + short_text(radius) + ")");
  v.require(corner <= v['L'],
            "L (" + short_text(v['L']) + ") must be at least R (" + short_text(corner) + ")");
  return tip_and_flank(radius - corner, corner, radius, v['L']);
}

Outline round_cylinder(const Values& v) {
  v.require(v['L'] >= v['D'] / 2, "L (" + short_text(v['L']) + ") must be at least D/2 (" +
                                      short_text(v['D'] / 2) + "), the height of the round end");
  return tip_and_flank(0, v['D'] / 2, v['D'] / 2, v['L']);
}

Outline cone(const Values& v) {
  const double length = v['L'];
  const double slope =
      v.has('A') ? std::tan(units::from_degree(v['A'])) : (v['D'] - v['T']) / (2 * length);
  const double tip = v['D'] / 2 - slope * length;
  v.require(tip >= 0,
            v.has('A') ? "A and L make the tip's diameter negative (" + short_text(2 * tip) + " mm)"
                       : "T (" + short_text(v.get('T', 0)) + ") must be smaller than D (" +
                             short_text(v['D']) + ")");
  v.require(slope > 0, "the tip must be narrower than D (" + short_text(v['D']) + ")",
            "for a head that widens to the tip use inverted-cone, for an even one cylinder");
  const double corner = v.get('R', 0), a = std::atan(slope);
  const double flat = tip - corner * (1 - std::sin(a)) / std::cos(a);
  v.require(flat >= 0 && (corner == 0 || corner * (1 + std::sin(a)) < length),
            "R (" + short_text(corner) + ") does not fit the tip", "for a round end use taper");
  return tip_and_flank(flat, corner, v['D'] / 2, length);
}

Outline taper(const Values& v) {
  const double half = v['D'] / 2, length = v['L'];
  double round = v.get('T', 0) / 2;
  if (v.has('A')) {
    const double a = units::from_degree(v['A']);
    round = (half * std::cos(a) - length * std::sin(a)) / (1 - std::sin(a));
    v.require(
        round > 0, "A and L leave no room for a round tip",
        "A must be below " + short_text(units::to_degree(std::atan(half / length))) + " degrees");
  }
  v.require(round > 0, "T must be above 0", "for a pointed tip use cone");
  v.require(round < half,
            "T (" + short_text(2 * round) + ") must be smaller than D (" + short_text(v['D']) + ")",
            "for an even head use round-cylinder");
  v.require(length > half,
            "L (" + short_text(length) + ") must be larger than D/2 (" + short_text(half) + ")");
  return tip_and_flank(0, round, half, length);
}

// Widest at the tip's corner, narrowing to the shank's end.
Outline narrowing(const Values& v, double corner) {
  const double half = v['D'] / 2, length = v['L'];
  v.require(corner <= half,
            "R (" + short_text(corner) + ") must not exceed D/2 (" + short_text(half) + ")");
  v.require(length > corner,
            "L (" + short_text(length) + ") must be larger than R (" + short_text(corner) + ")");
  double end = v.get('N', 0) / 2;
  if (v.has('A')) {
    const double a = -units::from_degree(v['A']);
    end = half - corner + (corner + std::sin(a) * (length - corner)) / std::cos(a);
    v.require(end > 0, "A and L make the diameter at the shank's end negative");
  }
  v.require(end < half, "the shank's end must be narrower than D (" + short_text(v['D']) + ")",
            "for a head that widens to the shank use cone or taper");
  v.require(std::hypot(end - (half - corner), length - corner) > corner,
            "N (" + short_text(2 * end) + ") lies inside the rounded corner",
            "choose a larger L or a smaller R");
  return tip_and_flank(half - corner, corner, end, length);
}

Outline inverted_cone(const Values& v) { return narrowing(v, v.get('R', 0)); }
Outline pear(const Values& v) { return narrowing(v, v.get('R', v['D'] / 2)); }

Outline nose(const Values& v, double height) {
  const double radius = v['D'] / 2, blunt = v.get('T', 0) / 2;
  v.require(blunt < radius, "T (" + short_text(2 * blunt) + ") must be smaller than D (" +
                                short_text(v['D']) + ")");
  v.require(height >= radius,
            "B (" + short_text(height) + ") must be at least D/2 (" + short_text(radius) + ")",
            "for a round end use round-cylinder");
  v.require(height < v['L'],
            "B (" + short_text(height) + ") must be smaller than L (" + short_text(v['L']) + ")");
  return ogive(radius, height, blunt);
}

Outline flame(const Values& v) {
  const double radius = v['D'] / 2, length = v['L'], height = v.get('B', 0.6 * length);
  const double end = v.get('N', 0.8 * v['D']) / 2;
  v.require(end < radius,
            "N (" + short_text(2 * end) + ") must be smaller than D (" + short_text(v['D']) + ")",
            "for an even head use torpedo");
  Outline outline = nose(v, height);
  const double in = radius - end, up = length - height;
  v.require(up >= in,
            "B (" + short_text(height) + ") leaves too little length to narrow from D to N");
  const double rho = (in * in + up * up) / (2 * in);
  outline.push_back(arc_piece(radius, height, end, length, radius - rho, height));
  close_head(outline);
  return outline;
}

Outline torpedo(const Values& v) {
  const double height = v.get('B', v['D']);
  Outline outline = nose(v, height);
  outline.push_back(line_piece(v['D'] / 2, height, v['D'] / 2, v['L']));
  close_head(outline);
  return outline;
}

struct Shape {
  const char* name;
  const char* example;
  const char* required;
  const char* either;  // exactly one of these
  const char* optional;
  Outline (*build)(const Values&);
};

constexpr Shape kShapes[] = {
    {"ball", "ball:D1.2", "D", "", "S", ball},
    {"cylinder", "cylinder:D1.2xL3.0", "DL", "", "RS", cylinder},
    {"round-cylinder", "round-cylinder:D1.2xL8.0", "DL", "", "S", round_cylinder},
    {"cone", "cone:D1.2xL4.0xT0.6", "DL", "TA", "RS", cone},
    {"taper", "taper:D1.8xL8.0xT1.0", "DL", "TA", "S", taper},
    {"inverted-cone", "inverted-cone:D0.8xL0.8xA10", "DL", "NA", "RS", inverted_cone},
    {"pear", "pear:D0.8xL1.8xA4xR0.3", "DL", "NA", "RS", pear},
    {"flame", "flame:D1.2xL8.0", "DL", "", "BNTS", flame},
    {"torpedo", "torpedo:D1.4xL10.0", "DL", "", "BTS", torpedo},
};

const Shape* find_shape(const std::string& name) {
  for (const Shape& shape : kShapes)
    if (name == shape.name) return &shape;
  return nullptr;
}

std::string described(const char* letters) {
  std::string out;
  for (const char* l = letters; *l; ++l)
    out += (l == letters ? "" : " or ") + std::string(1, *l) + " (" + letter_of(*l).meaning + ")";
  return out;
}

Values parse(const std::string& spec, const Shape& shape, const std::string& parameters) {
  const std::string place = "--bur " + spec;
  const std::string use = "write " + shape_notation(shape.name) + ", such as " + shape.example;
  const std::string taken = std::string(shape.required) + shape.either + shape.optional;
  std::map<char, double> values;
  std::istringstream parts(parameters);
  for (std::string part; std::getline(parts, part, 'x');) {
    if (part.empty()) throw InputError(place, "", "an x with nothing before or after it", use);
    const char letter =
        part[0] >= 'a' && part[0] <= 'z' ? static_cast<char>(part[0] - 'a' + 'A') : part[0];
    if (taken.find(letter) == std::string::npos)
      throw InputError(place, "'" + part + "'",
                       std::string(shape.name) + " has no parameter '" + part[0] + "'", use);
    const Letter& known = letter_of(letter);
    double value = 0;
    const char *from = part.data() + 1, *end = part.data() + part.size();
    const auto read = std::from_chars(from, end, value);
    const std::string what = std::string(1, letter) + " (" + known.meaning + ")";
    if (read.ec != std::errc() || read.ptr != end || from == end || !std::isfinite(value))
      throw InputError(place, "'" + part + "'",
                       what + " must be a number, such as " + letter + "1.2");
    if (value < known.least || value > known.most)
      throw InputError(
          place, "'" + part + "'",
          what + " must be within " + short_text(known.least) + " .. " + short_text(known.most));
    if (!values.emplace(letter, value).second)
      throw InputError(place, "'" + part + "'", what + " is given twice");
  }
  if (!parameters.empty() && parameters.back() == 'x')
    throw InputError(place, "", "an x with nothing before or after it", use);
  for (const char* l = shape.required; *l; ++l)
    if (values.count(*l) == 0)
      throw InputError(place, "", "needs " + described(std::string(1, *l).c_str()), use);
  int given = 0;
  for (const char* l = shape.either; *l; ++l) given += static_cast<int>(values.count(*l));
  if (*shape.either && given != 1)
    throw InputError(place, "",
                     (given == 0 ? "needs " : "needs only one of ") + described(shape.either), use);
  return Values(spec, std::move(values));
}

}  // namespace

bool is_shape(const std::string& name) { return find_shape(name) != nullptr; }

std::vector<std::string> shape_names() {
  std::vector<std::string> names;
  for (const Shape& shape : kShapes) names.push_back(shape.name);
  return names;
}

std::string shape_notation(const std::string& name) {
  const Shape* shape = find_shape(name);
  if (!shape) return "";
  std::string out = name;
  const auto add = [&](const char* before, char letter, const char* after) {
    out += before;
    out += letter;
    out += after;
  };
  for (const char* l = shape->required; *l; ++l) add(l == shape->required ? ":" : "x", *l, "..");
  for (const char* l = shape->either; *l; ++l) add(l == shape->either ? "x" : "|", *l, "..");
  for (const char* l = shape->optional; *l; ++l) add("[x", *l, "..]");
  return out;
}

double default_neck_diameter(const std::vector<ProfilePiece>& head) {
  const ProfilePiece& last = head.back();
  const bool disc = last.kind == ProfilePiece::Kind::kLine && last.z0 == last.z1;
  double widest = 0;
  for (const ProfilePiece& piece : head) widest = std::max(widest, bounds_of(piece).r_max);
  return std::min(kLargestNeckDiameter, disc ? 0.8 * 2 * last.r0 : 0.5 * 2 * widest);
}

Bur bur_from_shorthand(const std::string& spec) {
  const std::size_t colon = spec.find(':');
  const std::string name = spec.substr(0, colon);
  const Shape* shape = find_shape(name);
  if (!shape) {
    std::string known;
    for (const std::string& s : shape_names()) known += (known.empty() ? "" : ", ") + s;
    throw InputError("--bur " + spec, "", "unknown shape '" + name + "'", "known are " + known);
  }
  const Values values =
      parse(spec, *shape, colon == std::string::npos ? std::string() : spec.substr(colon + 1));
  const Outline head = shape->build(values);
  double length = 0;
  for (const ProfilePiece& piece : head) length = std::max(length, bounds_of(piece).z_max);
  const double neck = values.get('S', default_neck_diameter(head));
  const double top = std::min(length + kNeckLength, 50.0);
  try {
    return Bur(spec, head, top > length ? neck / 2 : 0, top);
  } catch (const Error& error) {
    throw InputError("--bur " + spec, "", error.what());
  }
}

}  // namespace toothprep
