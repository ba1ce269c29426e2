#include "toothprep/step/grinding/swept_outline.h"

#include <algorithm>
#include <cmath>

namespace toothprep {
namespace {

// Sines: of the motion from the axis at least; of its lean against square to the axis from which on edges draw
// (SweptEdge); of an edge.
constexpr double kLeastAcross = 0.1, kLeastLean = 3e-3, kEdge = 1e-3;
// So many lines touch a half circle.
constexpr int kLinesAround = 24, kLeastLines = 2, kHalvings = 12;

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

void SweptOutline::add(const Direction& n, double reach, double stretch, double from, double to,
                       double moves, const ProfilePiece* face) noexcept {
  if (count_ == kMostLines) return;
  const auto f = [](double x) { return static_cast<float>(x); };
  lines_[count_++] = {f(n.l / stretch),
                      f(n.h / stretch),
                      f(reach / stretch),
                      f(from),
                      f(to),
                      f(moves),
                      false,
                      false,
                      face};
}

bool SweptOutline::draw(const std::vector<ProfilePiece>& outline, const Vec3& along) noexcept {
  count_ = 0;
  const double across = std::sqrt(along.x() * along.x() + along.y() * along.y()), lean = along.z();
  if (across < kLeastAcross) return false;
  const Vec3 feed(along.x() / across, along.y() / across, 0);
  axes_ = {Vec3(feed.y(), -feed.x(), 0), Vec3(-lean * feed.x(), -lean * feed.y(), across), along};
  // A normal across the motion, and in the half plane of the profile.
  struct Normal {
    Direction of;
    double r, a;  // from the axis and along it
  };
  const auto normal_of = [&](const Direction& n) {
    return Normal{n, std::sqrt(n.l * n.l + n.h * n.h * lean * lean), n.h * across};
  };
  // That of which so much is along the axis.
  const auto direction_of = [&](double along_axis) {
    return Direction::rising(along_axis / across);
  };
  // Where the bur touches at a point of its profile, along the motion; and how that moves with the point.
  const auto touches = [&](const Normal& n, double r, double z) {
    return lean * (z - (n.r > kEdge ? r * n.of.h * across / n.r : 0));
  };
  // Normals between two, evenly; of a circle, which is seen as an ellipse, evenly around that as well.
  const auto over = [&](const Direction& low, const Direction& high, bool is_circle,
                        const ProfilePiece* before, const ProfilePiece* after, const auto& of) {
    const auto place = [&](double t) {
      if (!is_circle) return t;
      const Direction n = Direction::by_half(t);
      return t + Direction::of(n.l, n.h * std::abs(lean)).half();
    };
    const double from = low.half(), to = high.half(), first = place(from), last = place(to);
    const int n =
        std::max(kLeastLines, static_cast<int>(std::ceil(kLinesAround * (last - first) / 2)));
    const std::size_t begin = count_;
    for (int i = 0; i <= n; ++i) {
      const double wanted = first + (last - first) * i / n;
      double below = from, above = to;
      for (int halving = 0; is_circle && halving < kHalvings; ++halving) {
        const double middle = 0.5 * (below + above);
        (place(middle) < wanted ? below : above) = middle;
      }
      const double between = is_circle ? 0.5 * (below + above) : wanted;
      of(normal_of(Direction::by_half(i == 0 ? from : i == n ? to : between)));
    }
    for (std::size_t i = begin; i < count_; ++i)
      lines_[i].has_before = i > begin, lines_[i].has_after = i + 1 < count_;
    if (count_ > begin) lines_[begin].face = before, lines_[count_ - 1].face = after;
  };
  // The faces. Where the lines of an edge or an arc end as a face goes on, the face tells where it touches.
  for (const ProfilePiece& piece : outline) {
    const ProfilePoint at = point_on(piece, 0);
    const double rises = -at.along_r / across;
    if (piece.kind == ProfilePiece::Kind::kArc) continue;
    if (!(std::abs(rises) <= 1 || std::abs(lean) <= kLeastLean)) continue;
    const Normal n = normal_of(Direction::rising(rises));
    const double a = touches(n, piece.r0, piece.z0), b = touches(n, piece.r1, piece.z1);
    // The end of the bur touches with all of it.
    const double wide = std::abs(at.along_z) < kEdge ? std::max(piece.r0, piece.r1) : 0;
    add(n.of, piece.r0 * at.along_z - piece.z0 * at.along_r, 1, std::min(a, b) - wide,
        std::max(a, b) + wide, 0, &piece);
  }
  ProfilePoint before{0, 0, 1, 0};
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const ProfilePiece &piece = outline[i], *last = i > 0 ? &outline[i - 1] : nullptr,
                       *next = i + 1 < outline.size() ? &outline[i + 1] : nullptr;
    const ProfilePoint from = point_on(piece, 0), to = point_on(piece, 1);
    const double turn = before.along_r * from.along_z - before.along_z * from.along_r;
    if (turn > kEdge && std::abs(lean) > kLeastLean && from.r > 0) {
      const double out_r = (before.along_r - from.along_r) / turn,
                   out_z = (before.along_z - from.along_z) / turn;
      over(direction_of(-before.along_r), direction_of(-from.along_r), true, last, &piece,
           [&](const Normal& n) {
             const double at = touches(n, from.r, from.z), out = out_r * n.r + out_z * n.a;
             add(n.of, from.r * n.r + from.z * n.a - kBeforeFaces, out, at, at,
                 -touches(n, out_r, out_z));
           });
    }
    if (piece.kind == ProfilePiece::Kind::kArc) {
      const double to_r = piece.r0 - piece.centre_r, to_z = piece.z0 - piece.centre_z,
                   radius = std::sqrt(to_r * to_r + to_z * to_z);
      const Direction low = direction_of(-from.along_r), high = direction_of(-to.along_r);
      const auto touch = [&](const Normal& n) {
        const double r = piece.centre_r + radius * n.r, z = piece.centre_z + radius * n.a,
                     at = touches(n, r, z);
        add(n.of, r * n.r + z * n.a - kBeforeFaces, 1, at, at, 0);
      };
      over(low, high, piece.centre_r > 0 && std::abs(lean) > kLeastLean, last, next, touch);
    }
    before = to;
  }
  return count_ < kMostLines;
}

SweptOutline::Sample SweptOutline::at(const Float4& l, const Float4& h) const noexcept {
  const Float4 beside = magnitude(l);
  Float4 least_one = all4(1e3f);
  Int4 nearest{};
  for (std::size_t i = 0; i < count_; ++i) {
    const Float4 value = lines_[i].reach - lines_[i].l * beside - lines_[i].h * h;
    const Int4 nearer = value < least_one;
    least_one = nearer ? value : least_one;
    nearest = nearer ? Int4{} + static_cast<std::int32_t>(i) : nearest;
  }
  Sample s{least_one, {}, {}, {}, {}};
  for (int p = 0; p < 4; ++p)
    bend(p, beside[p], h[p], &lines_[static_cast<std::size_t>(nearest[p])], s);
  s.by_l = turned_where_negative(l, s.by_l);
  return s;
}

// Between three lines of an arc the value at a place is a parabola, nearly.
void SweptOutline::bend(int p, float beside, float h, const Line* nearest,
                        Sample& s) const noexcept {
  const Line* middle = nearest;
  if (!nearest->has_before && nearest->has_after) ++middle;
  if (!nearest->has_after && nearest->has_before) --middle;
  Line there = *middle;
  if (middle->has_before && middle->has_after) {
    const Line &before = middle[-1], &after = middle[1];
    const auto at = [&](const Line& of) { return of.reach - of.l * beside - of.h * h; };
    const float a = at(before), here = at(*middle), b = at(after), rises = 0.5f * (b - a),
                bends = a + b - 2 * here;
    const float x =
        bends > 0 ? std::clamp(-rises / bends, -1.0f, 1.0f) : static_cast<float>(nearest - middle);
    const auto between = [&](float of_before, float of_middle, float of_after) {
      return of_middle + x * (0.5f * (of_after - of_before) +
                              0.5f * x * (of_after + of_before - 2 * of_middle));
    };
    s.value[p] = between(a, here, b);
    there.l = between(before.l, middle->l, after.l),
    there.h = between(before.h, middle->h, after.h);
    there.from = between(before.from, middle->from, after.from);
    there.to = between(before.to, middle->to, after.to);
    there.moves = between(before.moves, middle->moves, after.moves);
    const Line* end = x == -1 ? &before : x == 1 ? &after : nullptr;
    if (end && end->face) {
      const auto is_face = [&](const Line& of) { return of.face == end->face; };
      there = *std::find_if(lines_.begin(), lines_.begin() + count_, is_face);
    }
  }
  s.by_l[p] = -there.l, s.by_h[p] = -there.h;
  s.from[p] = there.from + s.value[p] * there.moves, s.to[p] = there.to + s.value[p] * there.moves;
}

}  // namespace toothprep
