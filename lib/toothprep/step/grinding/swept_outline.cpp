#include "toothprep/step/grinding/swept_outline.h"

#include <algorithm>
#include <cmath>

namespace toothprep {
namespace {

// Sines: of the motion from the axis at least; of its lean against square to the axis from which on edges draw
// (SweptEdge); of an edge.
constexpr double kAcrossAtLeast = 0.1, kLeanAtLeast = 3e-3, kEdgeSine = 1e-3;
// So many lines touch a half circle.
constexpr int kLinesAround = 24, kLeastLines = 2, kLineHalvings = 12;

constexpr float kNoLine = 1e3f;  // mm

// mm, by which lines of arcs and edges lie before those of faces: these bend on from where a face ends.
constexpr double kBeforeFaces = 1e-6;

}  // namespace

// A unit vector across the motion, beside the bur's axis (not negative) and along it.
struct SweptOutline::Direction {
  double l, h;
  static Direction of(double l, double h) {
    const double length = std::sqrt(l * l + h * h);
    return {l / length, h / length};
  }
  static Direction rising(double h) {
    const double sine = std::clamp(h, -1.0, 1.0);
    return {std::sqrt(1 - sine * sine), sine};
  }
  // Tangent of half of the angle by which it rises: no library's sine is in a result.
  double half() const { return h / (1 + l); }
  static Direction by_half(double t) { return of(1 - t * t, 2 * t); }
};

void SweptOutline::add(const Direction& n, double reach, double stretch, double touches,
                       double moves) noexcept {
  if (count_ == kMostLines) return;
  const auto f = [](double x) { return static_cast<float>(x); };
  lines_[count_++] = {f(n.l / stretch),
                      f(n.h / stretch),
                      f(reach / stretch),
                      f(touches),
                      f(moves),
                      false,
                      false,
                      -1};
}

// How a bur's profile is seen along its motion, which goes so much square to its axis and along it.
struct SweptOutline::View {
  double across, lean;

  // A normal across the motion, and in the half plane of the profile.
  struct Normal {
    Direction of;
    double r, a;  // from the axis and along it
  };
  Normal normal_of(const Direction& n) const {
    return {n, std::sqrt(n.l * n.l + n.h * n.h * lean * lean), n.h * across};
  }
  // That of which so much is along the axis.
  Direction direction_of(double along_axis) const { return Direction::rising(along_axis / across); }

  // Where the bur touches at a point of its profile: seen along the motion, and along it; and how that moves with the
  // point.
  struct Point {
    double l, h, along;
  };
  Point touches(const Normal& n, double r, double z) const {
    if (!(n.r > kEdgeSine)) return {0, z * across, lean * z};
    const double beside = r * n.of.l / n.r, ahead = -r * n.of.h * lean / n.r;
    return {beside, z * across - lean * ahead, lean * z + across * ahead};
  }

  // Normals between two, evenly; of a circle, which is seen as an ellipse, evenly around that as well.
  template <typename Of>
  void between(const Direction& low, const Direction& high, bool is_circle, const Of& of) const {
    const auto place = [&](double t) {
      if (!is_circle) return t;
      const Direction n = Direction::by_half(t);
      return t + Direction::of(n.l, n.h * std::abs(lean)).half();
    };
    const double from = low.half(), to = high.half(), first = place(from), last = place(to);
    const int n =
        std::max(kLeastLines, static_cast<int>(std::ceil(kLinesAround * (last - first) / 2)));
    for (int i = 0; i <= n; ++i) {
      const double wanted = first + (last - first) * i / n;
      double below = from, above = to;
      for (int halving = 0; is_circle && halving < kLineHalvings; ++halving) {
        const double middle = 0.5 * (below + above);
        (place(middle) < wanted ? below : above) = middle;
      }
      const double t = is_circle ? 0.5 * (below + above) : wanted;
      of(normal_of(Direction::by_half(i == 0 ? from : i == n ? to : t)));
    }
  }
};

std::int32_t SweptOutline::line_of(const ProfilePiece* face) const noexcept {
  for (std::size_t i = 0; i < face_count_; ++i)
    if (face && faces_[i].of == face) return static_cast<std::int32_t>(i);
  return -1;
}

void SweptOutline::add_face(const View& view, const ProfilePiece& face,
                            const ProfilePiece* next) noexcept {
  const ProfilePoint at = point_on(face, 0);
  const double rises = -at.along_r / view.across;
  if (face_count_ == kMostFaces) return;
  if (!(std::abs(rises) <= 1 || std::abs(view.lean) <= kLeanAtLeast)) return;
  const View::Normal n = view.normal_of(Direction::rising(rises));
  const View::Point a = view.touches(n, face.r0, face.z0), b = view.touches(n, face.r1, face.z1);
  const double dl = b.l - a.l, dh = b.h - a.h, square = dl * dl + dh * dh,
               slope = square > kEdgeSine * kEdgeSine ? (b.along - a.along) / square : 0;
  const auto f = [](double x) { return static_cast<float>(x); };
  Face& to = faces_[face_count_];
  to = {&face,
        f(slope * dl),
        f(slope * dh),
        f(std::min(a.along, b.along)),
        f(std::max(a.along, b.along)),
        0,
        0};
  // The end of the bur touches with all of it, but for what is nearer to the face around it.
  if (std::abs(face.z1 - face.z0) < kEdgeSine * (face.r1 - face.r0) && next) {
    const ProfilePoint around = point_on(*next, 0);
    to.radius = f(face.r1);
    if (around.along_z > kEdgeSine) to.narrows = f((1 - around.along_r) / around.along_z);
  }
  add(n.of, face.r0 * at.along_z - face.z0 * at.along_r, 1, a.along - slope * (dl * a.l + dh * a.h),
      0);
  lines_[face_count_].face = static_cast<std::int32_t>(face_count_);
  ++face_count_;
}

void SweptOutline::add_edge(const View& view, const ProfilePoint& before, const ProfilePoint& from,
                            const ProfilePiece* last, const ProfilePiece* next) noexcept {
  const double turn = before.along_r * from.along_z - before.along_z * from.along_r;
  if (!(turn > kEdgeSine && std::abs(view.lean) > kLeanAtLeast && from.r > 0)) return;
  const double out_r = (before.along_r - from.along_r) / turn,
               out_z = (before.along_z - from.along_z) / turn;
  const std::size_t begin = count_;
  view.between(view.direction_of(-before.along_r), view.direction_of(-from.along_r), true,
               [&](const View::Normal& n) {
                 add(n.of, from.r * n.r + from.z * n.a - kBeforeFaces, out_r * n.r + out_z * n.a,
                     view.touches(n, from.r, from.z).along, -view.touches(n, out_r, out_z).along);
               });
  join(begin, last, next);
}

void SweptOutline::add_arc(const View& view, const ProfilePiece& arc, const ProfilePiece* last,
                           const ProfilePiece* next) noexcept {
  const double to_r = arc.r0 - arc.centre_r, to_z = arc.z0 - arc.centre_z,
               radius = std::sqrt(to_r * to_r + to_z * to_z);
  const std::size_t begin = count_;
  view.between(view.direction_of(-point_on(arc, 0).along_r),
               view.direction_of(-point_on(arc, 1).along_r),
               arc.centre_r > 0 && std::abs(view.lean) > kLeanAtLeast, [&](const View::Normal& n) {
                 const double r = arc.centre_r + radius * n.r, z = arc.centre_z + radius * n.a;
                 add(n.of, r * n.r + z * n.a - kBeforeFaces, 1, view.touches(n, r, z).along, 0);
               });
  join(begin, last, next);
}

void SweptOutline::join(std::size_t begin, const ProfilePiece* last,
                        const ProfilePiece* next) noexcept {
  for (std::size_t i = begin; i < count_; ++i)
    lines_[i].has_before = i > begin, lines_[i].has_after = i + 1 < count_;
  if (count_ > begin) lines_[begin].face = line_of(last), lines_[count_ - 1].face = line_of(next);
}

SweptOutline::Axes SweptOutline::axes_of(const Vec3& along) noexcept {
  const double across = std::sqrt(along.x() * along.x() + along.y() * along.y()), lean = along.z();
  const Vec3 feed(along.x() / across, along.y() / across, 0);
  return {Vec3(feed.y(), -feed.x(), 0), Vec3(-lean * feed.x(), -lean * feed.y(), across), along};
}

bool SweptOutline::draw(const std::vector<ProfilePiece>& outline, const Vec3& along) noexcept {
  count_ = face_count_ = 0;
  const double across = std::sqrt(along.x() * along.x() + along.y() * along.y()), lean = along.z();
  if (across < kAcrossAtLeast) return false;
  axes_ = axes_of(along);
  const View view{across, lean};
  const auto next_of = [&](std::size_t i) {
    return i + 1 < outline.size() ? &outline[i + 1] : nullptr;
  };
  // The faces first. Where the lines of an edge or an arc end as a face goes on, the face tells where it touches.
  for (std::size_t i = 0; i < outline.size(); ++i)
    if (outline[i].kind != ProfilePiece::Kind::kArc) add_face(view, outline[i], next_of(i));
  ProfilePoint before{0, 0, 1, 0};
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const ProfilePiece &piece = outline[i], *last = i > 0 ? &outline[i - 1] : nullptr;
    add_edge(view, before, point_on(piece, 0), last, &piece);
    if (piece.kind == ProfilePiece::Kind::kArc) add_arc(view, piece, last, next_of(i));
    before = point_on(piece, 1);
  }
  lines_[count_] = {0, 0, kNoLine, 0, 0, false, false, -1};  // of a pair
  return count_ < kMostLines && face_count_ < kMostFaces;
}

SweptOutline::Sample SweptOutline::at(const Float4& l, const Float4& h) const noexcept {
  const Float4 beside = magnitude(l);
  // By two halves, so that one needn't wait for the other.
  Float4 least_one[2] = {all4(kNoLine), all4(kNoLine)};
  Int4 nearest[2] = {};
  for (std::size_t i = 0; i < count_; i += 2)
    for (std::size_t k = 0; k < 2; ++k) {
      const Line& line = lines_[i + k];
      const Float4 value = line.reach - line.l * beside - line.h * h;
      const Int4 nearer = value < least_one[k];
      least_one[k] = least(value, least_one[k]);
      nearest[k] = nearer ? Int4{} + static_cast<std::int32_t>(i + k) : nearest[k];
    }
  // The first one, if there are several.
  const Int4 second =
      (least_one[1] < least_one[0]) | ((least_one[1] == least_one[0]) & (nearest[1] < nearest[0]));
  Sample s;
  bend(beside, h, second ? nearest[1] : nearest[0], s);
  s.by_l = turned_where_negative(l, s.by_l);
  return s;
}

// Between three lines of an arc the value at a place is a parabola, nearly.
void SweptOutline::bend(const Float4& beside, const Float4& h, const Int4& nearest,
                        Sample& s) const noexcept {
  const Line* middle[4];
  Float4 off{};  // of the nearest from the middle one of three
  for (int p = 0; p < 4; ++p) {
    const Line* const near = &lines_[static_cast<std::size_t>(nearest[p])];
    middle[p] = near->has_before == near->has_after ? near : near->has_after ? near + 1 : near - 1;
    off[p] = static_cast<float>(near - middle[p]);
  }
  const bool bends_on = middle[0]->has_before || middle[1]->has_before || middle[2]->has_before ||
                        middle[3]->has_before;
  const auto of_each = [&](std::ptrdiff_t which, float Line::*field) {
    const auto at = [&](int p) { return middle[p][middle[p]->has_before ? which : 0].*field; };
    return Float4{at(0), at(1), at(2), at(3)};
  };
  struct Three {
    Float4 before, middle, after;
  };
  const auto three = [&](float Line::*field) {
    const Float4 here = of_each(0, field);
    return bends_on ? Three{of_each(-1, field), here, of_each(1, field)} : Three{here, here, here};
  };
  const Three l = three(&Line::l), up = three(&Line::h), reach = three(&Line::reach);
  const Float4 a = reach.before - l.before * beside - up.before * h,
               here = reach.middle - l.middle * beside - up.middle * h,
               b = reach.after - l.after * beside - up.after * h, rises = 0.5f * (b - a),
               bends = a + b - 2 * here;
  const Float4 x = bends > 0 ? within(-rises / bends, all4(1)) : off;
  const auto between = [&](const Three& of) {
    return of.middle +
           x * (0.5f * (of.after - of.before) + 0.5f * x * (of.after + of.before - 2 * of.middle));
  };
  s.value = between({a, here, b});
  s.by_l = -between(l), s.by_h = -between(up);
  s.from = s.to = between(three(&Line::touches)) + s.value * between(three(&Line::moves));
  for (int p = 0; p < 4; ++p) {
    const Line& end = middle[p][!middle[p]->has_before ? 0 : x[p] == -1 ? -1 : x[p] == 1 ? 1 : 0];
    if (end.face < 0) continue;
    const Line& face = lines_[static_cast<std::size_t>(end.face)];
    const Face& of = faces_[static_cast<std::size_t>(end.face)];
    s.by_l[p] = -face.l, s.by_h[p] = -face.h;
    const float touches = std::clamp(face.touches + of.by_l * beside[p] + of.by_h * h[p], of.low,
                                     of.high),
                radius = of.radius - s.value[p] * of.narrows,
                wide = radius > beside[p] ? std::sqrt(radius * radius - beside[p] * beside[p]) : 0;
    s.from[p] = touches - wide, s.to[p] = touches + wide;
  }
}

}  // namespace toothprep
