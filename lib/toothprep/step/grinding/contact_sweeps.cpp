// Straight parts of the bur's way: what it took there is known exactly, and by which of them each point of the lattice was
// cut. Where these are known around four pieces, so is what is covered of them, however thin.
#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/contact_cut.h"
#include "toothprep/step/grinding/contact_frame.h"
#include "toothprep/step/grinding/contact_parts.h"

namespace toothprep {
namespace {

// Points that lie deeper than this (voxels) in tissue say nothing of where the cut's surface is nearby.
constexpr float kDeepInTissue = 1.8f;
// Looked at ahead of a piece, voxels.
constexpr float kAheadOfPiece = 1.5f;
// Of the way, so many parts are looked through, the latest ones.
constexpr SweepHistory::Number kLatest = 32;

// A bur that is off a straight part of its way by less than this (voxels) moves along it again; or on, at its end.
constexpr double kRetraced = 0.05;
// Or where the bur went over it deeper than this (voxels).
constexpr double kInsideSweep = 0.002;

// So far ahead (voxels) it is looked at how a share changes on the way.
constexpr float kOnWay = 0.1f;
// Walls along the motion rise by less than this (sine).
constexpr float kAlongWalls = 0.3f;
// Over a piece a border is straight if it is off by less than this (voxels) at its corners.
constexpr float kStraightBorder = 0.01f;
// How one part's depth may rise above another's, over the way; by less than this (voxels) doesn't count. By how much more
// than the way a place is along a part.
constexpr float kMayRise = -2, kSameDepth = 0.005f, kMayBend = 1.5f;
constexpr float kToCorner = 0.75f;  // of both halves of a piece together
constexpr float kNothing = -1e3f;
// Parts that are longer than this (mm) are known even where the pass under way has been alone.
constexpr double kLong = 1;
// One pass skips no more than so many numbers: short parts that no point of the lattice has.
constexpr SweepHistory::Number kNext = 3;
// Where parts don't tell they aren't looked for again for so much of the way (voxels): ahead of pieces, at one place.
constexpr double kNoPartsAhead = 1, kNoPartsHere = 0.5;
// Walls whose normals differ by less than this cosine's angle are as good as one.
constexpr float kTurnsAway = 0.95f;
// A border moves on for so much of the way (voxels), or until a share has changed by so much.
constexpr float kStraightMoves = 0.2f, kBentMoves = 0.5f;
// Of a piece: less is covered, or left, of those that a border only begins to cross, or is about to leave.
constexpr float kUndivided = 0.05f;

constexpr float kSides[] = {-1, 1};
// Whether a border is off by more than `most` (mm) at the four corners of pieces, where the cut is so deep.
Int4 is_off(const Borders& border, const Float4 (&at_corners)[4], float most) {
  Int4 off{};
  for (int k = 0; k < 4; ++k)
    off |= magnitude(at_corners[k] - (border.value + kSides[k & 1] * border.along +
                                      kSides[k >> 1] * border.around)) > most;
  return off;
}

}  // namespace

// The latest part of the way for which `holds` does; null if there is none.
template <class Holds>
const StraightSweep* ContactModel::latest_part(const Scan& scan, const Holds& holds) noexcept {
  if (!scan.history) return nullptr;
  const SweepHistory::Number latest = scan.history->latest();
  for (SweepHistory::Number n = latest; n > latest - kLatest; --n) {
    const StraightSweep* const part = scan.history->find(n);
    if (!part) break;
    if (scan.history->is_own(*part) && holds(*part)) return part;
  }
  return nullptr;
}

// The part that the bur moves along again with v (W, mm/s).
const StraightSweep* ContactModel::retraced_by(const Scan& scan, const Vec3& v) const noexcept {
  if (scan.turns) return nullptr;
  const double aside = kRetraced * scan.workpiece.voxel();
  return latest_part(scan, [&](const StraightSweep& part) {
    return part.leads_through(bur_, sampled_pose_, v, aside);
  });
}

// Whether a bur went straight over a place (W), by the parts that cut deepest around it.
bool ContactModel::went_over(const Scan& scan, const Vec3& place) const noexcept {
  if (!scan.history) return false;
  const double inside = kInsideSweep * scan.workpiece.voxel();
  const Vec3 in = scan.workpiece.lattice().to_index(place);
  float by[8];
  cell_corners(scan.history->deepest(), static_cast<int>(std::floor(in.x())),
               static_cast<int>(std::floor(in.y())), static_cast<int>(std::floor(in.z())), by);
  std::sort(by, by + 8);
  float last = 0;
  for (const float number : by) {
    if (number == last) continue;
    last = number;
    const StraightSweep* const part = scan.history->find(static_cast<SweepHistory::Number>(number));
    if (part && part->was_over(scan.history->bur_of(*part), place, inside)) return true;
  }
  return false;
}

// The part on which the bur moves on.
SweepHistory::Number ContactModel::leads_here(const Scan& scan) const noexcept {
  const SweepHistory::Number latest = scan.history ? scan.history->latest() : 0;
  const StraightSweep* const part = latest > 0 ? scan.history->find(latest) : nullptr;
  if (!part || !scan.history->is_own(*part)) return 0;
  const Vec3 direction = sampled_pose_.orientation * scan.direction;
  const double aside = kRetraced * scan.workpiece.voxel();
  return part->leads_to(bur_, sampled_pose_, direction, aside) ? latest : 0;
}

// What a bur took in a part of its way, as places of this sample have it; null if that isn't known.
const KnownSweep* ContactModel::known(const Scan& scan,
                                      SweepHistory::Number number) const noexcept {
  const StraightSweep* const part = scan.history->find(number);
  if (!part) return nullptr;
  Known& there = known_[static_cast<std::size_t>(number % kKnown)];
  const ConvexProfile& standing = scan.history->standing(*part);
  if (there.number != number || !there.sweep.is_of(standing, *part)) {
    there.number = number, there.placed = 0;
    there.sweep.set(standing, *part);
  }
  if (!there.sweep.is_known()) return nullptr;
  if (there.placed != sample_) {
    there.placed = sample_;
    there.sweep.put(scan.workpiece.lattice(), scan.frame.base);
  }
  return &there.sweep;
}

// The parts that cut the lattice's points around some places: met, asked whether they tell, and found.
struct ContactModel::NearSweeps {
  static constexpr int kMost = 20;
  const ContactModel& model;
  const Scan& scan;
  int count = 0;
  SweepHistory::Number numbers[kMost];
  const KnownSweep* sweeps[kMost];  // once they are found
  Int4 known;                       // of lanes: whether the numbers of all that cut there are

  NearSweeps(const ContactModel& of, const Scan& in, const Int4& wanted)
      : model(of), scan(in), known(wanted) {}

  // Those of the cells of places (voxels, from the tip's), but for that which leads here.
  void meet(const Place& at) noexcept {
    const FourPlaces in(at.x, at.y, at.z);
    const Index3& base = scan.frame.base;
    for (int p = 0; p < kPieces; ++p)
      if (known[p] && !meet(Index3(in.x[p] + base.x(), in.y[p] + base.y(), in.z[p] + base.z())))
        known[p] = 0;
  }

  // Whether they tell more than the lattice's values do. Of the pass under way these tell everything, where it bends evenly.
  // False if no parts were met, or more than kMost.
  bool tell() noexcept {
    if (count == 0 || !add_between()) return false;
    bool all_long = true, under_way = is_one_pass(numbers[count - 1], scan.history->latest());
    for (int k = 0; k < count; ++k) {
      const StraightSweep* const part = scan.history->find(numbers[k]);
      if (!part) return false;
      all_long &= part->way.squaredNorm() > kLong * kLong;
      under_way = under_way && scan.history->is_own(*part) &&
                  (k == 0 || is_one_pass(numbers[k - 1], numbers[k]));
    }
    return !under_way || all_long;
  }
  bool is_one_pass(SweepHistory::Number from, SweepHistory::Number to) const noexcept {
    if (to - from > kNext) return false;
    const StraightSweep* before = scan.history->find(from);
    for (SweepHistory::Number n = from + 1; before && n <= to; ++n) {
      const StraightSweep* const part = scan.history->find(n);
      if (!part || !part->follows(*before)) return false;
      before = part;
    }
    return true;
  }
  // Whether all of them are known.
  bool find() noexcept {
    for (int k = 0; k < count; ++k) {
      sweeps[k] = model.known(scan, numbers[k]);
      if (!sweeps[k]) return false;
    }
    for (int k = 1; k < count; ++k)  // not two in one place
      if ((numbers[k] - numbers[k - 1]) % kKnown == 0) return false;
    return true;
  }

  // Those around pieces with their middles `here` and `far`, and `on` (voxels) ahead of them; `beside` gives their corners.
  // Whether they tell and are known.
  template <class Beside>
  bool find_around(const Place& here, const Place& far, const Eigen::Vector3f& on,
                   const Beside& beside) noexcept {
    meet(Place{scan.frame, here.x + on.x(), here.y + on.y(), here.z + on.z()}), meet(far);
    for (const float y : {-kNearCorner, kNearCorner})
      for (const float x : {-kNearCorner, kNearCorner}) meet(beside(here, x, y));
    meet(here);
    return any(known) && tell() && find();
  }

  KnownSweep::Sample at(const Place& place) const noexcept {
    KnownSweep::Sample taken{all4(kNothing), Float4{}, Float4{}, Float4{}};
    for (int k = 0; k < count; ++k)
      taken = KnownSweep::deeper(taken, sweeps[k]->at(place.x, place.y, place.z));
    return taken;
  }

  // The same, and of the parts that may end within `rim` (mm) of the place that which goes most across the deepest one: in
  // the corner between two of them, one border alone would leave too much.
  struct Walls {
    KnownSweep::Sample deepest, across;
  };
  Walls walls_at(const Place& place, const Float4& rim) const noexcept {
    const KnownSweep::Sample none{all4(kNothing), Float4{}, Float4{}, Float4{}};
    KnownSweep::Sample of[kMost];
    Walls walls{none, none};
    for (int k = 0; k < count; ++k) {
      of[k] = sweeps[k]->at(place.x, place.y, place.z);
      walls.deepest = KnownSweep::deeper(walls.deepest, of[k]);
    }
    const KnownSweep::Sample& to = walls.deepest;
    const auto voxel = static_cast<float>(scan.workpiece.voxel());
    Float4 least = all4(kTurnsAway * voxel * voxel);
    for (int k = 0; k < count; ++k) {
      const Float4 dot = of[k].gx * to.gx + of[k].gy * to.gy + of[k].gz * to.gz;
      const Int4 better = (of[k].value > -rim) & (of[k].value < to.value) & (dot < least);
      walls.across = KnownSweep::chosen(better, of[k], walls.across);
      least = better ? dot : least;
    }
    return walls;
  }

  // The same as at(), of what is left after leaving out those that are shallower than others, there and as far around as `around`
  // (mm).
  KnownSweep::Sample at_and_keep_deepest(const Place& place, const Float4& around) noexcept {
    KnownSweep::Sample of[kMost];
    bool starts[kMost], ends[kMost], kept[kMost];
    for (int k = 0; k < count; ++k) {
      KnownSweep::Beyond beyond;
      of[k] = sweeps[k]->at(place.x, place.y, place.z, &beyond);
      starts[k] = !any(known & ~(beyond.start > kMayBend * around));
      ends[k] = !any(known & ~(beyond.end > kMayBend * around));
    }
    leave_out_ends(starts, ends, kept);
    KnownSweep::Sample taken{all4(kNothing), Float4{}, Float4{}, Float4{}};
    for (int k = 0; k < count; ++k)
      if (kept[k]) taken = KnownSweep::deeper(taken, of[k]);
    const float same = kSameDepth * static_cast<float>(scan.workpiece.voxel());
    for (int k = 0; k < count; ++k) {
      const Float4 above = of[k].value - taken.value;
      kept[k] = kept[k] && any(known & (above > kMayRise * around));
      deepest_[k] = any(known & (above > -same));
    }
    keep(kept);
    return taken;
  }

  // At places around that one: what is taken there, of what is left after leaving out those that are nowhere deepest.
  template <std::size_t kPlaces>
  void at_and_keep_deepest(const Place (&places)[kPlaces], Float4 (&taken)[kPlaces]) noexcept {
    bool kept[kMost];
    std::copy_n(deepest_, count, kept);
    const float same = kSameDepth * static_cast<float>(scan.workpiece.voxel());
    for (std::size_t i = 0; i < kPlaces; ++i) {
      Float4 of[kMost];
      taken[i] = all4(kNothing);
      for (int k = 0; k < count; ++k) {
        of[k] = sweeps[k]->at(places[i].x, places[i].y, places[i].z).value;
        taken[i] = greatest(taken[i], of[k]);
      }
      for (int k = 0; k < count; ++k) kept[k] |= any(known & (of[k] > taken[i] - same));
    }
    keep(kept);
  }

 private:
  // The cells that were met, each in a place of its own among 4 x 4 x 4.
  struct Met {
    Index3 at;
    bool known;
  };
  std::uint64_t met_ = 0;  // a bit of each
  bool deepest_[kMost];    // in the middle
  std::array<Met, 64> cells_;

  // Those of a cell; whether there are no others.
  bool meet(const Index3& cell) noexcept {
    const int place = (cell.x() & 3) | (cell.y() & 3) << 2 | (cell.z() & 3) << 4;
    const std::uint64_t bit = std::uint64_t{1} << place;
    Met& met = cells_[static_cast<std::size_t>(place)];
    if ((met_ & bit) && met.at == cell) return met.known;
    float values[8], by[8];
    cell_corners(scan.workpiece.cut(), cell.x(), cell.y(), cell.z(), values);
    cell_corners(scan.history->deepest(), cell.x(), cell.y(), cell.z(), by);
    const auto voxel = static_cast<float>(scan.workpiece.voxel());
    bool all = true;
    SweepHistory::Number last = scan.leads_here;
    for (int k = 0; k < 8 && all; ++k) {
      if (values[k] < -kDeepInTissue * voxel || values[k] > kFarOff * voxel) continue;
      const auto number = static_cast<SweepHistory::Number>(by[k]);
      if (number > 0 && (number == last || number == scan.leads_here)) continue;
      all = add(number);
      last = number;
    }
    met_ |= bit, met.at = cell, met.known = all;
    return all;
  }
  // Leaves out parts of which only the beginning or the end tells, which is their neighbour's as well.
  void leave_out_ends(const bool (&starts)[kMost], const bool (&ends)[kMost],
                      bool (&kept)[kMost]) const noexcept {
    std::fill_n(kept, count, true);
    const auto has_before = [&](int k) {
      return k > 0 && kept[k - 1] && numbers[k - 1] == numbers[k] - 1 && sweeps[k]->sweep().goes_on;
    };
    const auto has_after = [&](int k) {
      return k + 1 < count && kept[k + 1] && numbers[k + 1] == numbers[k] + 1 &&
             sweeps[k + 1]->sweep().goes_on;
    };
    for (int k = count; k-- > 0;)
      if (starts[k] && has_before(k)) kept[k] = false;
    for (int k = 0; k < count; ++k)
      if (ends[k] && has_after(k)) kept[k] = false;
  }
  void keep(const bool (&kept)[kMost]) noexcept {
    int left = 0;
    for (int k = 0; k < count; ++k)
      if (kept[k])
        numbers[left] = numbers[k], sweeps[left] = sweeps[k], deepest_[left++] = deepest_[k];
    count = left;
  }
  // Adds those between two of one pass, if they lean along the way: the lattice's points name none that is deepest only
  // between them, where the end's lower edge was.
  bool add_between() noexcept {
    std::sort(numbers, numbers + count);
    bool all = true;
    for (int k = count; k-- > 1;)
      if (numbers[k] - numbers[k - 1] <= kNext)
        for (SweepHistory::Number n = numbers[k - 1] + 1; n < numbers[k]; ++n)
          if (const StraightSweep* const part = scan.history->find(n); part && part->leans())
            all &= add(n);
    std::sort(numbers, numbers + count);
    return all;
  }
  bool add(SweepHistory::Number number) noexcept {
    if (number <= 0) return false;
    for (int k = 0; k < count; ++k)
      if (numbers[k] == number) return true;
    if (count == kMost) return false;
    numbers[count++] = number;
    return true;
  }
};

// How deep places of an element (voxels, from the tip's) lie in what was taken; 0 where that isn't known.
Float4 ContactModel::taken_by_sweeps(const Scan& scan, int i, const Place& at) noexcept {
  double& parts_from = standing_[i].parts_here_from;
  if (way_ < parts_from) return Float4{};
  NearSweeps near(*this, scan, Int4{-1, -1, -1, -1});
  near.meet(at);
  if (!near.tell() || !near.find()) {
    parts_from = way_ + kNoPartsHere * scan.workpiece.voxel();
    return Float4{};
  }
  return near.known ? near.at(at).value : Float4{};
}

// Pieces around which the parts that cut there are known; the others are left. `far`: their middles, farther ahead. Where a
// sample a little ahead `lessened` what is covered and nothing but the part that leads here cut around a piece, all of it is
// tissue: what was found ahead lies beyond it.
Int4 ContactModel::cover_by_sweeps(const Scan& scan, const CutOfPieces& cut, const Place& far,
                                   const Int4& wanted, const Int4& lessened,
                                   Lanes& s) const noexcept {
  const Int4 may_be_whole = wanted & lessened;
  if (way_ < *s.parts_from && !any(may_be_whole)) return Int4{};
  const float voxel = cut.voxel;
  const Float4 rim = cut.half_along + cut.half_around;
  // In the middle of the step to come, so that a wall that is met head-on counts neither early nor late.
  const Eigen::Vector3f back = s.ahead - 0.5f * static_cast<float>(step_) * s.unit;
  const Place here{scan.frame, s.ix - back.x(), s.iy - back.y(), s.iz - back.z()};
  const auto beside = [&](const Place& from, float along, float around) {
    const Displaced d = cut.displaced(all4(along), all4(around));
    const float* a = scan.frame.a;
    return Place{scan.frame, from.x + (a[0] * d.x + a[1] * d.y + a[2] * d.z),
                 from.y + (a[3] * d.x + a[4] * d.y + a[5] * d.z),
                 from.z + (a[6] * d.x + a[7] * d.y + a[8] * d.z)};
  };
  NearSweeps near(*this, scan, wanted);
  if (!near.find_around(here, far, kAheadOfPiece * voxel * s.unit, beside)) {
    *s.parts_from = way_ + kNoPartsAhead * static_cast<double>(voxel);
    return near.count == 0 ? cover_whole(near.known & may_be_whole, s) : Int4{};
  }
  const KnownSweep::Sample middle = near.at_and_keep_deepest(here, kToCorner * rim);
  const Int4 good = near.known & (middle.value > -rim - kBeyondRim * voxel);
  const Int4 whole = cover_whole(near.known & may_be_whole & ~good, s);
  if (!any(good)) return whole;
  const PieceAxes& axes = cut.axes;
  const auto border_of_part = [&](const Parts::Part& part, const KnownSweep::Sample& taken) {
    const Float4 x = all4(part.x), y = all4(part.y), wide = 1 + axes.widening * x,
                 turned = axes.widening * y;
    // In B, per mm.
    const FourSamples g = scan.frame.gradients({taken.value, taken.gx, taken.gy, taken.gz});
    const Float4 around = axes.around(g);
    return Borders{taken.value,
                   part.half_along * (axes.along(g) + turned * around + 2 * x * axes.bent_along(g)),
                   part.half_around * (wide * around + 2 * y * axes.bent_around(g))};
  };
  const Borders border = border_of_part(Parts::Part::whole(), middle);
  // Where the border is straight, or far from the piece, one part tells.
  const Place corners[kPieces] = {
      beside(here, kSides[0], kSides[0]), beside(here, kSides[1], kSides[0]),
      beside(here, kSides[0], kSides[1]), beside(here, kSides[1], kSides[1])};
  Float4 at_corners[kPieces];
  near.at_and_keep_deepest(corners, at_corners);
  const Int4 bent = is_off(border, at_corners, kStraightBorder * voxel);
  const auto rise_of = [&](const KnownSweep::Sample& taken) {
    return cut.rise(scan.frame.gradients({taken.value, taken.gx, taken.gy, taken.gz}));
  };
  Float4 doubt;  // of what is thinner than is known
  if (any(good & bent)) {
    const float on_way = kOnWay * voxel, per_way = 1 / on_way;
    Float4 rises[Parts::kCount];
    KnownSweep::Sample across[Parts::kCount];
    Parts parts([&](int k, const Parts::Part& part) {
      const Place place = beside(here, part.x, part.y);
      const NearSweeps::Walls walls = near.walls_at(
          place, part.half_along * cut.half_along + part.half_around * cut.half_around);
      const KnownSweep::Sample& taken = walls.deepest;
      across[k] = walls.across;
      rises[k] = rise_of(taken);
      // Where a part of the way ends in front of the piece, another one takes over.
      if (any(good & (magnitude(rises[k]) > kAlongWalls))) {
        const Eigen::Vector3f step = on_way * s.unit;
        const Place later{scan.frame, place.x + step.x(), place.y + step.y(), place.z + step.z()};
        rises[k] = per_way * (near.at(later).value - taken.value);
      }
      return border_of_part(part, taken);
    });
    for (int k = 0; k < Parts::kCount; ++k)
      if (any(across[k].value > kNothing))
        parts.divide(k, border_of_part(Parts::Part(k), across[k]), rise_of(across[k]));
    parts.cover(cut, good, kThinSlot * voxel, s);
    const CoveredPart<Float4> later = parts.covered(on_way, rises);
    s.per_way = {per_way * (later.share - s.share), per_way * (later.x - s.x),
                 per_way * (later.y - s.y)};
    s.by_rates |= good;
    doubt = parts.doubt();
  } else {
    Parts parts(border);
    parts.cover(cut, good, kThinSlot * voxel, s);
    s.by_slots &= ~good;
    doubt = parts.doubt();
  }
  s.rise = good ? rise_of(middle) : s.rise;
  // The lattice's border, of which this was noted, isn't the one that counts.
  s.moves = good ? all4(kUnlimited) : s.moves;
  const Int4 sure = doubt == 0,
             divided = good & sure & (s.share > kUndivided) & (s.share < 1 - kUndivided);
  // What was met just now and is still thinner than is known counts soon, not when it was met.
  s.note_crossing(good, border.value + doubt, border.along, border.around, rise_of(middle), kHolds);
  const Float4 soon = s.moves;
  s.moves = divided ? all4(kUnlimited) : s.moves;
  s.note_crossing(divided, border.value, border.along, border.around, rise_of(middle), kBentMoves);
  if (any(good & bent))
    s.note_rate(good, s.per_way.share);
  else
    s.moves = good & sure ? all4(kStraightMoves * voxel) : soon;
  s.by_sweeps = good;
  return good | whole;
}

// All of these is tissue.
Int4 ContactModel::cover_whole(const Int4& where, Lanes& s) noexcept {
  s.cover(where, {all4(1), Float4{}, Float4{}});
  s.cut.replace(where, Borders::none());
  s.rise = where ? Float4{} : s.rise;
  return where;
}

}  // namespace toothprep
