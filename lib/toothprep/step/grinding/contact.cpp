#include "toothprep/step/grinding/contact.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "toothprep/step/grinding/advance_kernels.h"
#include "toothprep/step/grinding/contact_frame.h"

namespace toothprep {
namespace {

constexpr double kMarginCosine = 0.9988;  // a little inside sqrt(1 - 0.05²)
// While the handle turns, a trial velocity of less than this part of the sample's needs a new one.
constexpr double kLeastSpeed = 0.5;
constexpr float kRounding = 1e-6f;  // of the speed
// Elements look for the walls of other cuts this part of their size ahead.
constexpr double kLookAhead = 0.8;
// A head has a sharp edge where its outline turns by more than this (sine).
constexpr double kSharpEdge = 0.3;
constexpr double kDoubted = 0.005;  // mm of way after a cut, within which all is looked at anew
// The way's curvature is taken over so much of it, mm. What lies ahead is taken to be straight as long as that bends
// by less than this (voxels), and no farther than this (mm).
constexpr double kBendsOver = 0.1, kStraight = 0.005, kFarthest = 0.5;
// It is taken for an arc where that goes so many times as far, until it has turned by this (rad).
constexpr double kRatherArc = 1.5, kMostTurn = 0.4;
constexpr double kCorner = 0.3;       // rad; turns more suddenly
constexpr double kLeastAside = 0.01;  // of the axis from the direction, sine squared

struct Turn {
  Vec3 by;     // rad/mm, W
  double off;  // rad/mm, of the direction, that it doesn't explain
};

// A sample stands while the direction turns by no more than this (rad): what begins to advance then
// has next to no v·n.
constexpr double kSteady = 2e-3;

// How far the element's rim lies behind its tangent plane, mm.
float sag_of(const SurfaceElements& e, std::size_t i) {
  return 0.5f * (e.curvature_along[i] * e.half_along[i] * e.half_along[i] +
                 e.curvature_around[i] * e.half_around[i] * e.half_around[i]);
}

}  // namespace

ContactModel::ContactModel(const Bur& bur, double piece_size, bool clockwise,
                           const PerTissue<GrindingProperties>& tissue)
    : elements_(bur.elements(kPiecesAcross * piece_size, clockwise)),
      contact_(kPieces * kTissueCount * elements_.size(), tissue, false),
      walls_(bur.profile()),
      bur_(bur),
      slot_(SweptSlot::of(bur.profile())),
      look_ahead_(kLookAhead * kPiecesAcross * piece_size),
      most_held_(kStays * piece_size),
      arm_(std::hypot(bur.head_length(), bur.max_radius())) {
  const std::size_t n = elements_.size();
  // By fours, of which choose() takes them; those beyond the last are never worth a look.
  const std::size_t by_fours = (n + kPieces - 1) / kPieces * kPieces;
  for (auto* array : {&left_, &slack_, &advance_, &range_, &looked_x_, &looked_y_, &looked_z_})
    array->resize(by_fours);
  for (auto* array : {&worth_, &candidates_, &to_look_}) array->resize(by_fours);
  found_.assign(by_fours, Found::kVoid);
  standing_.resize(n);
  cells_.resize(n);
  near_.resize(n), far_.resize(n);
  fields_.resize(n), tissues_.resize(n);
  settled_.assign(n, -1), moves_.assign(n, -1), cut_moves_.assign(n, -1);
  been_.reserve(kMostBeen);
  known_.resize(kKnown);
  for (std::size_t i = 0; i < n; ++i) add_element(i);
  note_edges(bur);
  first_node_.push_back(static_cast<std::int32_t>(nodes_.size()));
}

void ContactModel::add_element(std::size_t i) {
  const SurfaceElements& e = elements_;
  mx_.push_back(e.y[i] * e.nz[i] - e.z[i] * e.ny[i]);
  my_.push_back(e.z[i] * e.nx[i] - e.x[i] * e.nz[i]);
  mz_.push_back(e.x[i] * e.ny[i] - e.y[i] * e.nx[i]);
  shapes_.push_back({e.x[i], e.y[i], e.z[i], sag_of(e, i), e.lx[i], e.ly[i], e.lz[i],
                     e.half_along[i], e.tx[i], e.ty[i], e.half_around[i],
                     std::hypot(e.half_along[i], e.half_around[i])});
  turn_around_.push_back(e.curvature_around[i] * e.half_around[i]);
  turn_along_.push_back(e.curvature_along[i] * e.half_along[i]);
  first_node_.push_back(static_cast<std::int32_t>(nodes_.size()));
  const bool curved = e.curvature_along[i] != 0;
  const double gauss = 1 / std::sqrt(3.0);
  ContactSet::Sums sums;
  for (const double around : {-gauss, gauss})
    for (const double along : {-gauss, gauss}) {
      if (!curved && along > 0) continue;
      nodes_.push_back(point_of(i, around, curved ? along : 0, curved ? 0.25 : 0.5));
      sums.add(nodes_.back());
    }
  sums_.push_back(sums);
  for (int p = 0; p < kPieces; ++p) {
    add_piece(i, (2 * p + 1.0) / kPieces - 1, 0, kPieces, 1, strips_);
    add_piece(i, (p >> 1) - 0.5, (p & 1) - 0.5, kPiecesAcross, kPiecesAcross, squares_);
  }
}

// Which elements lie at a sharp edge.
void ContactModel::note_edges(const Bur& bur) {
  const SurfaceElements& e = elements_;
  edge_.assign(e.size(), 0);
  for (const SharpEdge& edge : sharp_edges(bur.profile(), kSharpEdge))
    for (std::size_t i = 0; i < e.size(); ++i) {
      const double r = static_cast<double>(e.radius[i]);
      const double to_r = edge.after.r - r, to_z = edge.after.z - static_cast<double>(e.z[i]);
      if (std::hypot(to_r, to_z) > 1.1 * static_cast<double>(e.half_along[i])) continue;
      const double along_r = (e.lx[i] * e.x[i] + e.ly[i] * e.y[i]) / r;
      edge_[i] = to_r * along_r + to_z * e.lz[i] < 0 ? -1 : 1;
      has_edges_ = true;
    }
}

// The point of element i at the given places (-1 .. 1) around the axis and along the profile, with
// a share of the element's weight.
ContactSet::Element ContactModel::point_of(std::size_t i, double around, double along,
                                           double share) const {
  const SurfaceElements& e = elements_;
  const double curvature = e.curvature_along[i], way = along * e.half_along[i];
  const double turn = around * e.half_around[i] / e.radius[i];
  const Vec3 l(e.lx[i], e.ly[i], e.lz[i]);
  Vec3 x(e.x[i], e.y[i], e.z[i]), n(e.nx[i], e.ny[i], e.nz[i]), t(e.tx[i], e.ty[i], 0);
  if (curvature == 0) {
    x += way * l;
  } else {
    const Vec3 turned = std::cos(curvature * way) * n + std::sin(curvature * way) * l;
    x += (turned - n) / curvature;
    n = turned;
  }
  const Mat3 about_axis = Eigen::AngleAxisd(turn, Vec3::UnitZ()).toRotationMatrix();
  x = about_axis * x;
  n = about_axis * n;
  t = about_axis * t;
  const Vec3 m = x.cross(n);
  const double weight = share * e.weight[i], radius = std::hypot(x.x(), x.y());
  const auto f = [](double value) { return static_cast<float>(value); };
  return {f(n.x()), f(n.y()), f(n.z()),  f(m.x()),  f(m.y()),          f(m.z()),
          f(t.x()), f(t.y()), f(weight), f(radius), f(weight * radius)};
}

// A piece of element i about the given place, of `across` around the axis and `up` along it.
void ContactModel::add_piece(std::size_t i, double around, double along, int across, int up,
                             Pieces& to) {
  const SurfaceElements& e = elements_;
  const ContactSet::Element p = point_of(i, around, along, 1.0 / (across * up));
  // The place itself, as point_of() has it: n x m / n² is the part of it across n.
  const Vec3 n(p.nx, p.ny, p.nz), t(p.tx, p.ty, 0), l = n.cross(t);
  const double curvature = e.curvature_along[i], way = along * e.half_along[i];
  const double turn = around * e.half_around[i] / e.radius[i];
  const Vec3 l0(e.lx[i], e.ly[i], e.lz[i]), n0(e.nx[i], e.ny[i], e.nz[i]);
  Vec3 x(e.x[i], e.y[i], e.z[i]);
  x += curvature == 0 ? Vec3(way * l0)
                      : Vec3((std::cos(curvature * way) - 1) / curvature * n0 +
                             std::sin(curvature * way) / curvature * l0);
  x = Eigen::AngleAxisd(turn, Vec3::UnitZ()) * x;
  const auto put = [](std::vector<float>& v, double value) {
    v.push_back(static_cast<float>(value));
  };
  put(to.x, x.x()), put(to.y, x.y()), put(to.z, x.z());
  put(to.nx, n.x()), put(to.ny, n.y()), put(to.nz, n.z());
  put(to.tx, t.x()), put(to.ty, t.y());
  // Upwards along the profile, whichever way n_t points.
  const double sign = l.dot(l0) < 0 ? -1 : 1;
  put(to.lx, sign * l.x()), put(to.ly, sign * l.y()), put(to.lz, sign * l.z());
  put(to.mx, p.mx), put(to.my, p.my), put(to.mz, p.mz);
  put(to.weight, p.weight), put(to.arm, p.arm);
  put(to.half_along, e.half_along[i] / up);
  // Nearer to the axis it is narrower; what it turns by around the axis is that of its own normal.
  const double radius = std::hypot(x.x(), x.y());
  put(to.half_around, e.half_around[i] / across * radius / e.radius[i]);
  put(to.curvature_around, e.curvature_around[i] == 0
                               ? 0
                               : (n.x() * x.x() + n.y() * x.y()) / (n.norm() * radius * radius));
}

void ContactModel::sample(const Workpiece& workpiece, const Pose& pose, const Vec3& v,
                          const Vec3& omega, double reach, std::uint64_t cuts,
                          std::span<const Pose> been, const SweepHistory* history) noexcept {
  been_.clear();
  for (const Pose& p : been.first(std::min(been.size(), kMostBeen)))
    been_.push_back({(p.orientation.conjugate() * pose.orientation).toRotationMatrix(),
                     p.to_local(pose.position)});
  // v is the chord of the step to come.
  if (pose.position != position_) step_ = (pose.position - position_).norm();
  position_ = pose.position;
  const IndexFrame f(workpiece.lattice(), pose);
  Scan scan{workpiece,
            f,
            v.cast<float>(),
            omega.cast<float>(),
            static_cast<float>(v.norm()),
            static_cast<float>(reach),
            omega.squaredNorm() > 0,
            cuts,
            history,
            nullptr,
            0,
            Vec3::Zero()};
  if (scan.speed > 0) scan.direction = scan.v.cast<double>() / scan.speed;
  const double way = way_since(scan, pose);
  if (holds(scan, way)) return;
  scan.unit = scan.unit_of(scan.v, scan.speed);
  begin(scan, pose, way);
  scan.retraced = retraced_by(scan, pose.orientation * v);
  ++sample_;
  look_along_way(scan);
  std::optional<AlongWay> farther;
  if (!scan.turning.isZero())
    scan.farther = &farther.emplace(scan, static_cast<float>(look_ahead_));
  leaves_slots_ = !scan.turns && !scan.farther && slot_ && slot_->move(scan.direction);
  advance(scan);
  const int candidates = choose(scan);
  contact_.clear();
  const int others = add_advancing(scan, candidates);
  for (int c = 0; c < others; ++c) settle(scan, candidates_[c]);
  if (!been_.empty()) held_ = 0;
}

// The way since the last sample, mm; what is looked for ahead lies elsewhere where the motion turns.
double ContactModel::way_since(const Scan& scan, const Pose& pose) const noexcept {
  const Vec3 turn = (sampled_pose_.orientation.conjugate() * pose.orientation).vec();
  const double way = (pose.position - sampled_pose_.position).norm() + 2 * turn.norm() * arm_;
  return scan.turns ? way : way + look_ahead_ * (scan.direction - sampled_direction_).norm();
}

// Whether the last sample still stands.
bool ContactModel::holds(const Scan& scan, double way) const noexcept {
  return sampled_ && been_.empty() && !scan.turns && !sampled_turning_ &&
         scan.cuts == sampled_cuts_ && (scan.direction - sampled_direction_).norm() <= kSteady &&
         way < held_;
}

// Takes the way since the last sample off what was found there.
void ContactModel::begin(Scan& scan, const Pose& pose, double way) noexcept {
  if (!sampled_ || scan.turns != sampled_turning_) {
    std::fill(left_.begin(), left_.end(), -1.0f);
  } else {
    const auto gone = static_cast<float>(way);
    for (float& left : left_) left -= gone;
  }
  way_ += way;
  path_ += (pose.position - sampled_pose_.position).norm();
  sampled_pose_ = pose;
  scan.leads_here = leads_here(scan);
  if (!sampled_ || scan.turns != sampled_turning_)
    for (auto* until : {&settled_, &moves_, &cut_moves_})
      std::fill(until->begin(), until->end(), -1.0);
  else if (scan.cuts != sampled_cuts_)
    doubt_what_was_found(scan.leads_here > 0);
  sampled_direction_ = scan.direction;
  sampled_speed_ = scan.speed;
  sampled_turning_ = scan.turns;
  sampled_cuts_ = scan.cuts;
  sampled_ = true;
}

// A cut was put in place: it makes void, and nothing else. It lies behind what is in contact, or hardly beside it, so
// that this is looked at anew within the next kDoubted of the way, one element after the other rather than all in
// one step. `own`: the cut is of a straight way that goes on, so that what earlier ways made of pieces stands.
void ContactModel::doubt_what_was_found(bool own) noexcept {
  const std::size_t n = settled_.size();
  const Standing* const known = standing_.data();
  for (std::size_t i = 0; i < n; ++i) {
    const double until = kDoubted * static_cast<double>(i) / static_cast<double>(n);
    if (!own || !known[i].by_sweeps) settled_[i] = std::min(settled_[i], way_ + until);
    moves_[i] = std::min(moves_[i], settled_[i]);
    if (!own || !known[i].by_sweeps) cut_moves_[i] = std::min(cut_moves_[i], way_ + until);
    if (found_[i] == Found::kInside) left_[i] = std::min(left_[i], static_cast<float>(until));
  }
}

// How far ahead walls may be taken to run along the motion: those that earlier passes left are as straight as
// this one has been, or as bent. A wall is round about the centre of the path's arc if the bur's axis turns with the path,
// or the path turns about that axis; what neither explains counts as swerving.
void ContactModel::look_along_way(Scan& scan) noexcept {
  if (!(scan.speed > 0)) return;
  const Quat& q = sampled_pose_.orientation;
  const Vec3 direction = q * scan.direction, axis = q * Vec3::UnitZ();
  const double way = path_ - bend_at_, bent = (direction - bend_direction_).norm() / kBendsOver;
  // The turn that takes both along, per mm, if there is one; and by how much it doesn't.
  const auto turn_over = [&](double mm) {
    const Vec3 of_axis = bend_axis_.cross(axis) / mm,
               rest = (direction - bend_direction_) / mm - of_axis.cross(direction),
               aside = axis.cross(direction);
    const double square = aside.squaredNorm();
    const double about = square > kLeastAside ? rest.dot(aside) / square : 0;
    return Turn{of_axis + about * axis, (rest - about * aside).norm()};
  };
  double bend = bend_, swerve = swerve_;
  if (way >= kBendsOver) {
    const Turn turn = turn_over(way);
    swerve = bend_direction_.isZero() ? 1 : (turn.by - turning_).norm() + turn.off;
    turning_ = turn.by;
    bend = bent * kBendsOver / way, bend_at_ = path_;
    bend_direction_ = direction, bend_axis_ = axis;
  } else {
    const Turn turn = turn_over(kBendsOver);
    swerve = std::max(swerve, (turn.by - way / kBendsOver * turning_).norm() + turn.off);
    bend = std::max(bend, bent);
  }
  // Where a bur that stands would go says nothing of its path.
  if (path_ > looked_along_) {
    bend_ = bend, swerve_ = swerve;
    // At a corner it begins anew, so that what follows doesn't depend on what was before.
    if (bent * kBendsOver > kCorner) {
      turning_ = Vec3::Zero(), bend_at_ = path_;
      bend_direction_ = direction, bend_axis_ = axis;
    }
  }
  looked_along_ = path_;
  const double aside = kStraight * scan.workpiece.voxel();
  const auto until = [&](double rate) {
    return std::min(kFarthest, std::sqrt(2 * aside / std::max(rate, 1e-6)));
  };
  const double straight = scan.turns ? 0 : until(bend),
               on_arc = std::min(until(swerve), kMostTurn / std::max(turning_.norm(), 1e-6));
  const bool bends = on_arc > kRatherArc * straight && on_arc > look_ahead_;
  if (bends) {
    const Vec3 turning = q.conjugate() * turning_;
    scan.turning = turning.cast<float>();
    scan.tangent =
        (scan.direction - 0.5 * step_ * turning.cross(scan.direction)).normalized().cast<float>();
  }
  scan.straight = static_cast<float>(bends ? on_arc : straight);
}

// v·n of every element, and half its range over the element. Where the handle turns, what was found along
// another direction doesn't stand.
void ContactModel::advance(const Scan& scan) noexcept {
  const SurfaceElements& e = elements_;
  const AdvancingElements elements = {static_cast<int>(e.size()),
                                      e.x.data(),
                                      e.y.data(),
                                      e.z.data(),
                                      e.nx.data(),
                                      e.ny.data(),
                                      e.nz.data(),
                                      e.lx.data(),
                                      e.ly.data(),
                                      e.lz.data(),
                                      e.tx.data(),
                                      e.ty.data(),
                                      turn_around_.data(),
                                      turn_along_.data(),
                                      looked_x_.data(),
                                      looked_y_.data(),
                                      looked_z_.data(),
                                      advance_.data(),
                                      range_.data(),
                                      worth_.data(),
                                      left_.data()};
  const FeedOfElements feed = {scan.v.x(),     scan.v.y(),     scan.v.z(),    scan.speed,
                               scan.omega.x(), scan.omega.y(), scan.omega.z()};
  const AdvanceKernel& kernel = fastest_advance_kernel();
  (scan.turns ? kernel.turning : kernel.straight)(elements, feed);
}

// The elements to settle: those that may advance, but for what is known to lie in the void. Those of
// which what was found stands no longer are looked at first.
int ContactModel::choose(const Scan& scan) noexcept {
  const int n = static_cast<int>(worth_.size());
  std::int32_t *const candidates = candidates_.data(), *const to_look = to_look_.data();
  const float *const left = left_.data(), *const slack = slack_.data();
  const Found* const found = found_.data();
  Float4 until = all4(static_cast<float>(most_held_));
  int count = 0, looks = 0;
  for (int i = 0; i < n; i += kPieces) {
    Int4 worth, kind;
    std::memcpy(&worth, &worth_[i], sizeof worth);
    worth = worth != 0;
    if (!any(worth)) continue;
    std::memcpy(&kind, &found[i], sizeof kind);
    const Float4 stay = load4(left + i);
    const Int4 stands = (kind == static_cast<std::int32_t>(Found::kVoid)) & (stay >= 0);
    until = worth & stands ? least(until, stay + load4(slack + i)) : until;
    worth &= ~stands;
    if (!any(worth)) continue;
    const Int4 anew = worth & (stay < 0);
    for (int p = 0; p < kPieces; ++p) {
      candidates[count] = to_look[looks] = i + p;
      count -= worth[p], looks -= anew[p];
    }
  }
  for (int l = 0; l < looks; l += kPieces) look(scan, to_look + l, std::min(kPieces, looks - l));
  // Until an element that is in the void may be reached.
  float held = least_of(until);
  for (int l = 0; l < looks; ++l) {
    const std::int32_t i = to_look[l];
    if (found[i] == Found::kVoid) held = std::min(held, left[i] + slack[i]);
  }
  held_ = held;
  return count;
}

// Of the candidates, adds those that are engaged as a whole and advance with every velocity that
// covers() allows; the others are left. Where the handle turns add_whole() tells.
int ContactModel::add_advancing(const Scan& scan, int candidates) noexcept {
  if (scan.turns || !been_.empty() || !contact_.is_linear()) return candidates;
  const float margin = kMarginSine * scan.speed;
  const float *advance = advance_.data(), *range = range_.data();
  const Found* found = found_.data();
  const Standing* standing = standing_.data();
  std::int32_t* const run = to_look_.data();  // of one tissue
  std::int32_t* const chosen = candidates_.data();
  int others = 0, count = 0;
  std::uint8_t only = 0;
  const auto add_run = [&] {
    if (count > 0) contact_.add_advancing(sums_.data(), run, count, only - 1);
    count = 0;
  };
  for (int c = 0; c < candidates; ++c) {
    const std::int32_t i = chosen[c];
    if (found[i] != Found::kInside || !(advance[i] - range[i] - margin > 0)) {
      chosen[others++] = i;
      continue;
    }
    if (standing[i].only != only) add_run();
    only = standing[i].only;
    run[count++] = i;
  }
  add_run();
  return others;
}

void ContactModel::settle(const Scan& scan, int i) noexcept {
  if (found_[i] == Found::kVoid) return;
  const Standing& s = standing_[i];
  const bool inside = found_[i] == Found::kInside, whole = advance_[i] >= range_[i];
  // What can only advance once the motion turns has no force yet.
  const auto none = [&] {
    const SurfaceElements& e = elements_;
    const float speed = scan.turns ? scan.velocity_at(e.x[i], e.y[i], e.z[i]).norm() : scan.speed;
    return advance_[i] + range_[i] <= kRounding * speed;
  };
  if (been_.empty() && s.only != 0 && s.inside_tooth && ((whole && inside) || none()))
    add_whole(scan, i, s.only - 1, inside ? 1 : s.share);
  else
    divide(scan, i);
}

// Whether all of element i advances with every v that covers() allows, so that sums tell all of it.
bool ContactModel::surely_advances(const Scan& scan, int i) const noexcept {
  if (!contact_.is_linear()) return false;
  const float surely = advance_[i] - range_[i] - kMarginSine * scan.speed;
  if (!scan.turns) return surely > 0;
  const float turning = mx_[i] * scan.omega.x() + my_[i] * scan.omega.y() + mz_[i] * scan.omega.z();
  const float spread = scan.omega.norm() * (elements_.half_along[i] + elements_.half_around[i]);
  return surely > turning &&
         static_cast<float>(kLeastSpeed) * (surely - turning) >= std::max(spread - turning, 0.0f);
}

// Element i in one tissue.
void ContactModel::add_whole(const Scan& scan, int i, int tissue, float share) noexcept {
  if (share == 1 && surely_advances(scan, i)) {
    contact_.add_advancing(sums_[i], 1, tissue, scan.turns);
    return;
  }
  for (std::int32_t n = first_node_[i]; n < first_node_[i + 1]; ++n)
    contact_.add(nodes_[n], tissue, share);
}

bool ContactModel::covers(const Vec3& v) const noexcept {
  const double speed = v.norm();
  if (speed == 0) return true;
  if (sampled_turning_ && speed < kLeastSpeed * sampled_speed_) return false;
  return v.dot(sampled_direction_) >= kMarginCosine * speed;
}

namespace {

// max(tooth, cut) at the voxel nearest to the middle of element i, which will do for a report; where
// the tooth has no tissue its own value.
float value_at(const SurfaceElements& e, std::size_t i, const Workpiece& workpiece,
               const ContactModel::IndexFrame& f) noexcept {
  const float* a = f.a;
  const float x = f.fx + a[0] * e.x[i] + a[1] * e.y[i] + a[2] * e.z[i];
  const float y = f.fy + a[3] * e.x[i] + a[4] * e.y[i] + a[5] * e.z[i];
  const float z = f.fz + a[6] * e.x[i] + a[7] * e.y[i] + a[8] * e.z[i];
  const Index3 v(f.base.x() + cell_of(x + 0.5f), f.base.y() + cell_of(y + 0.5f),
                 f.base.z() + cell_of(z + 0.5f));
  const float value = workpiece.solid().value(v.x(), v.y(), v.z());
  return value < 0 ? workpiece.cut().value(v.x(), v.y(), v.z()) : value;
}

}  // namespace

double area_in_tissue(const SurfaceElements& elements, const Workpiece& workpiece,
                      const Pose& pose) noexcept {
  const ContactModel::IndexFrame f(workpiece.lattice(), pose);
  double area = 0;
  for (std::size_t i = 0; i < elements.size(); ++i)
    if (value_at(elements, i, workpiece, f) < 0) area += elements.area[i];
  return area;
}

AreaInTissue::AreaInTissue(const SurfaceElements& elements)
    : elements_(elements),
      stands_(elements.size(), 0),
      groups_stand_((elements.size() + kGroup - 1) / kGroup, 0) {
  for (std::size_t i = 0; i < elements.size(); ++i)
    arm_ = std::max(arm_, Vec3(elements.x[i], elements.y[i], elements.z[i]).norm());
}

double AreaInTissue::at(const Workpiece& workpiece, const Pose& pose) noexcept {
  const bool turned = pose.orientation.coeffs() != looked_at_.orientation.coeffs();
  const double turn = turned ? pose.orientation.angularDistance(looked_at_.orientation) : 0;
  way_ += (pose.position - looked_at_.position).norm() + turn * arm_;
  looked_at_ = pose;
  if (way_ < all_stand_) return 0;
  const ContactModel::IndexFrame f(workpiece.lattice(), pose);
  // A middle and its nearest voxel are half a diagonal apart, then and now.
  const double apart = std::sqrt(3.0) * workpiece.voxel();
  double area = 0;
  all_stand_ = std::numeric_limits<double>::infinity();
  for (std::size_t group = 0; group < groups_stand_.size(); ++group) {
    double& stands = groups_stand_[group];
    if (!(way_ < stands)) {
      stands = std::numeric_limits<double>::infinity();
      const std::size_t end = std::min(elements_.size(), (group + 1) * kGroup);
      for (std::size_t i = group * kGroup; i < end; ++i) {
        if (!(way_ < stands_[i])) {
          const double value = value_at(elements_, i, workpiece, f);
          if (value < 0) area += elements_.area[i];
          stands_[i] = way_ + kStands * (std::min<double>(value, workpiece.band()) - apart);
        }
        stands = std::min(stands, stands_[i]);
      }
    }
    all_stand_ = std::min(all_stand_, stands);
  }
  return area;
}

}  // namespace toothprep
