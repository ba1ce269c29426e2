// Slots that a flat end left which leans along the motion. Floor and walls follow from where such a slot went, two
// numbers, and these from the lattice by least squares. Where one slot or two make all of the lattice's values around
// four pieces, what is covered is known however narrow the corners are.
#include <algorithm>
#include <cmath>
#include <utility>

#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/contact_cut.h"
#include "toothprep/step/grinding/contact_frame.h"
#include "toothprep/step/grinding/contact_parts.h"
#include "toothprep/step/grinding/covered_part.h"

namespace toothprep {
namespace {

// A slot that makes all of a piece void has nowhere more void than the lattice by this.
constexpr float kLessVoid = 0.01f;
// A value may be that of the bur's own print if it is no more than this (voxels) above it, nor than this part of how far
// that is away: on the way back the bur's own slot is little farther. All of a cell is print if its middle isn't that
// much above. With fewer values of a cell than this it isn't known what slot is there.
constexpr float kAbovePrint = 0.1f, kPartToPrint = 0.5f, kOtherThanPrint = 0.02f;
constexpr int kLeastValues = 4;
constexpr float kLeastSteep = 0.2f;  // squared, of a slot's field
constexpr int kSteps = 3;            // of least squares
constexpr float kDamped = 1e-5f, kLeastDamp = 1e-9f, kMostStep = 0.5f;  // of its matrix; mm

// The bur is in its own slot again if the lattice, where it differs by less than this (voxels), puts it there.
constexpr float kAsOwn = 0.1f;

// Where none are found it isn't tried again for so much of the way (voxels).
constexpr double kNoSlots = 2;

// Cells are looked at in pieces and so far beyond their corners (voxels), where a slot stands alone.
constexpr float kBeyondCorner = 1.5f;
constexpr int kCells = 9;

}  // namespace

struct ContactModel::Slots {
  using Place = SweptSlot::Place;

  const Scan& scan;
  const CutOfPieces& cut;
  const SweptSlot& slot;
  const ContactModel::Place& far;                // middles of the pieces, so far ahead
  Float4 from_print;                             // mm, there
  Place along, around, bent_along, bent_around;  // of the pieces
  Float4 rise[3], along_motion[3];  // over a cell, mm: along the pieces' normal, and the motion
  Place side[3];                    // of a cell
  Place from_tip;                   // of their middles, from the tip's voxel
  FourCells cells[kCells];
  Place first[kCells];     // corners, from the pieces' middles
  Float4 outside[kCells];  // of these from the pieces, along their normal, mm
  Place origin[2];         // of the slots
  Int4 near{};             // of which pieces they are looked for
  // The slot that each cell indicates: for which pieces, where it is, and the same with its other face put.
  struct CellSlot {
    Int4 of{};
    Place origin{}, with_other_face{};
    bool looked = false, put = false;
  } by_cell[kCells];

  Slots(const Scan& in, const CutOfPieces& of, const SweptSlot& swept,
        const ContactModel::Place& middles, const Float4& print)
      : scan(in), cut(of), slot(swept), far(middles), from_print(print) {
    const PieceAxes& p = cut.axes;
    const SweptEdge& edge = slot.edge();
    along = edge.across(p.along_x, p.along_y, p.along_z);
    around = edge.across(p.around_x, p.around_y, Float4{});
    bent_along = edge.across(p.bent_along_x, p.bent_along_y, p.bent_along_z);
    bent_around = edge.across(p.bent_around_x, p.bent_around_y, Float4{});
    const float square = cut.voxel * cut.voxel;
    for (int i = 0; i < 3; ++i) {
      const float *a = scan.frame.a + 3 * i, x = square * a[0], y = square * a[1],
                  z = square * a[2];
      side[i] = edge.across(all4(x), all4(y), all4(z));
      rise[i] = x * cut.nx + y * cut.ny + z * cut.nz;
      along_motion[i] = cut.per_speed * (x * cut.ux + y * cut.uy + z * cut.uz);
    }
    from_tip = far.x * side[0] + far.y * side[1] + far.z * side[2];
  }

  // At x, y (-1 .. 1) of the pieces.
  Place place(const Float4& x, const Float4& y) const {
    return x * along + y * (1 + cut.axes.widening * x) * around + x * x * bent_along +
           y * y * bent_around;
  }
  template <class T>
  static T to_corner(int k, const T (&of_side)[3]) {
    return all4(static_cast<float>(k >> 2)) * of_side[0] +
           all4(static_cast<float>((k >> 1) & 1)) * of_side[1] +
           all4(static_cast<float>(k & 1)) * of_side[2];
  }
  Place corner(int cell, int k) const { return first[cell] + to_corner(k, side); }

  void read(int cell, const Float4& x, const Float4& y, const Int4& wanted) {
    const Displaced d = cut.displaced(x, y);
    const IndexFrame& f = scan.frame;
    const FourPlaces at = far.beside(d.x, d.y, d.z);
    cells[cell].read(scan.workpiece.cut(), at.x + f.base.x(), at.y + f.base.y(), at.z + f.base.z(),
                     wanted);
    first[cell] = place(x, y) - (at.fx * side[0] + at.fy * side[1] + at.fz * side[2]);
    outside[cell] = cut.nx * d.x + cut.ny * d.y + cut.nz * d.z -
                    (at.fx * rise[0] + at.fy * rise[1] + at.fz * rise[2]);
  }
  // Whether a value may be that of the bur's own print: it says only that no slot is above it.
  Int4 is_print(int cell, int k) const {
    return cells[cell].corner(k) + from_print + outside[cell] + to_corner(k, rise) <
           least(all4(kAbovePrint * cut.voxel), kPartToPrint * from_print);
  }
  // In the middle of a cell.
  Place middle_place(int cell) const {
    return first[cell] + all4(0.5f) * (side[0] + side[1] + side[2]);
  }
  Float4 middle_of(int cell) const {
    const Float4 half = all4(0.5f);
    return cells[cell].at(half, half, half).value;
  }
  // Whether there is more than the print.
  Int4 is_other(int cell) const {
    const Float4 half = all4(0.5f);
    return middle_of(cell) + from_print + outside[cell] + half * (rise[0] + rise[1] + rise[2]) >
           kOtherThanPrint * cut.voxel;
  }
  // Whether a slot may be as near to a cell as `rim` (mm): so near the print tells nothing of it.
  Int4 may_be_near(int cell, const Float4& rim) const {
    const Float4 most = rim + kBeyondRim * cut.voxel;
    return (magnitude(middle_of(cell)) < most) & (is_other(cell) | (from_print < most));
  }
  SweptSlot::Sample sample(int slots, const Place& at) const {
    SweptSlot::Sample s = slot.at(at - origin[0]);
    if (slots == 1) return s;
    const SweptSlot::Sample other = slot.at(at - origin[1]);
    s.replace(other.value > s.value, other);
    return s;
  }
  // Of these pieces, those for which so many slots make a cell's values.
  Int4 explain(int slots, int cell, Int4 good) const {
    const float most = kExplained * cut.voxel, far_off = kFarOff * cut.voxel;
    for (int k = 0; k < kCorners && any(good); ++k) {
      const Float4 value = sample(slots, corner(cell, k)).value, has = cells[cell].corner(k),
                   over = value - has;
      good &= (magnitude(over) < most) | (is_print(cell, k) & (over < most)) |
              ((has > far_off) & (value > far_off));
    }
    return good;
  }
  Int4 explain(int slots, Int4 good) const {
    for (int cell = 0; cell < kCellsInPiece; ++cell) good = explain(slots, cell, good);
    return good;
  }
  // Of these pieces, those of which the first slot leaves nothing: what else there is takes more, and the lattice has
  // nowhere less void than that slot makes.
  Int4 leaves_nothing(Int4 good) const {
    const Float4 least = all4(-kThinSlot * cut.voxel);
    constexpr float kPlaces[kCellsInPiece][2] = {{0, 0}, {-1, -1}, {1, -1}, {-1, 1}, {1, 1}};
    for (const auto& [x, y] : kPlaces)
      good &= slot.at(place(all4(x), all4(y)) - origin[0]).value > least;
    return has_its_void(good, kLessVoid);
  }
  // Of these pieces, those around which the first slot makes nowhere more void than the lattice has, by so many voxels.
  Int4 has_its_void(Int4 good, float voxels) const {
    const Float4 most = all4(voxels * cut.voxel);
    for (int cell = 0; cell < kCellsInPiece; ++cell)
      for (int k = 0; k < kCorners && any(good); ++k)
        good &= slot.at(corner(cell, k) - origin[0]).value - cells[cell].corner(k) < most;
    return good;
  }
  // Puts a slot where a cell's gradient says. Whether there may be one along the motion.
  Int4 begin(int cell, const Int4& where, Place& at) const {
    const Float4 half = all4(0.5f);
    const FourSamples in_cell = cells[cell].at(half, half, half);
    const float per_square = 1 / (cut.voxel * cut.voxel);
    const auto sum = [&](const auto& of_side) {
      return per_square * in_cell.gx * of_side[0] + per_square * in_cell.gy * of_side[1] +
             per_square * in_cell.gz * of_side[2];
    };
    const SweptSlot::Sample s{in_cell.value, sum(side)};
    const Place from = middle_place(cell) - slot.place_of(s);
    at = from;
    Int4 values{};
    for (int k = 0; k < kCorners; ++k) values += 1 + is_print(cell, k);
    const Float4 steep = s.gradient.l * s.gradient.l + s.gradient.h * s.gradient.h;
    return where & (values >= kLeastValues) & (kAlong * magnitude(sum(along_motion)) < 1) &
           (steep > kLeastSteep) & (magnitude(s.value) < kFarOff * cut.voxel);
  }
  // One step of least squares, by the cells that count and of these the values that are no farther off than `most_off` (mm).
  void improve(Place& of, const Int4 (&counts)[kCells], const Float4& most_off) const {
    Float4 ll{}, lh{}, hh{};
    Place error{};
    for (int cell = 0; cell < kCells; ++cell) {
      if (!any(counts[cell])) continue;
      for (int k = 0; k < kCorners; ++k) {
        const SweptSlot::Sample s = slot.at(corner(cell, k) - of);
        const Float4 has = cells[cell].corner(k);
        const Int4 use = counts[cell] & ~is_print(cell, k) &
                         (magnitude(has) < kFarOff * cut.voxel) &
                         (magnitude(has - s.value) < most_off);
        const Place g{use ? s.gradient.l : Float4{}, use ? s.gradient.h : Float4{}};
        ll += g.l * g.l, lh += g.l * g.h, hh += g.h * g.h;
        error = error + (has - s.value) * g;
      }
    }
    const Float4 damp = kDamped * (ll + hh) + kLeastDamp;
    ll += damp, hh += damp;
    const Float4 per = 1 / (ll * hh - lh * lh), most = all4(kMostStep);
    of = of + Place{within(per * (lh * error.h - hh * error.l), most),
                    within(per * (lh * error.l - ll * error.h), most)};
  }
  // Of these pieces, those for which so many slots, found farther ahead, are what the lattice has here, but for the
  // bur's own print: where an earlier way bent in between they aren't.
  Int4 hold_here(int slots, const Lanes& s, Int4 good) const {
    const float most = kExplained * cut.voxel, far_off = kFarOff * cut.voxel;
    const Place from = all4(-1) * (s.fx * side[0] + s.fy * side[1] + s.fz * side[2]);
    const Float4 away =
        scan.reach * cut.per_speed * s.advance - (s.fx * rise[0] + s.fy * rise[1] + s.fz * rise[2]);
    for (int k = 0; k < kCorners && any(good); ++k) {
      const Float4 has = s.cells->cells.corner(k),
                   value = sample(slots, from + to_corner(k, side)).value, over = value - has;
      const Int4 print = has + away + to_corner(k, rise) < kAbovePrint * cut.voxel;
      good &= (over < most) & (print | (over > -most) | ((has > far_off) & (value > far_off)));
    }
    return good;
  }
  // Puts the first slot where the bur is, as nearly as the lattice says so. Of the pieces `where`, those of which it leaves
  // nothing.
  Int4 are_in_own_slot(const Int4& where) {
    const IndexFrame& f = scan.frame;
    origin[0] = slot.edge().across(Float4{}, Float4{}, all4(slot.edge().height())) +
                (all4(f.fx) * side[0] + all4(f.fy) * side[1] + all4(f.fz) * side[2]) - from_tip;
    const Int4 may_be = has_its_void(where, kAsOwn);
    if (!any(may_be)) return may_be;
    const Int4 nothing = leaves_nothing(may_be), open = may_be & ~nothing;
    if (!any(open)) return nothing;
    Int4 counts[kCells] = {};
    for (int cell = 0; cell < kCellsInPiece; ++cell) counts[cell] = open;
    for (int i = 0; i < kSteps; ++i) improve(origin[0], counts, all4(kAsOwn * cut.voxel));
    return nothing | leaves_nothing(open);
  }
  // Puts the slots of piece p where those of others are to be.
  void take_over(int p, const Int4& where) {
    for (Place& of : origin) {
      const Float4 l = all4(of.l[p] + from_tip.l[p]) - from_tip.l,
                   h = all4(of.h[p] + from_tip.h[p]) - from_tip.h;
      of = {where ? l : of.l, where ? h : of.h};
    }
  }
  // A cell shows a slot's floor alone, or a wall: the other is where the slot makes nowhere more void than the
  // lattice has.
  void put_other_face(Place& of, int cell, const Int4& where) const {
    if (slot.edge().draws() || !any(where)) return;
    const SweptSlot::Place gradient = slot.at(middle_place(cell) - of).gradient;
    const Int4 floor = magnitude(gradient.l) < magnitude(gradient.h);
    Float4 highest = of.h, before = all4(kUnlimited), behind = all4(-kUnlimited);
    for (int c = 0; c < kCellsInPiece; ++c)
      for (int k = 0; k < kCorners; ++k) {
        const Place at = corner(c, k);
        const Float4 has = cells[c].corner(k);
        const Int4 more = slot.at(at - of).value - has > kLessVoid * cut.voxel;
        const Float4 aside = slot.wall_at(at.h - of.h, has);
        highest = more ? greatest(highest, at.h - has) : highest;
        before = more ? least(before, at.l - aside) : before;
        behind = more ? greatest(behind, at.l + aside) : behind;
      }
    const Float4 nearer = of.l - before < behind - of.l ? before : behind;
    of.h = (where & ~floor) ? highest : of.h;
    of.l = (where & floor & (magnitude(nearer) < kUnlimited)) ? nearer : of.l;
  }
  void put(int number, const Place& at, const Int4& where) {
    Place& of = origin[number];
    of = {where ? at.l : of.l, where ? at.h : of.h};
  }
  const Place& other_face(int cell) {
    CellSlot& c = by_cell[cell];
    if (!std::exchange(c.put, true)) {
      c.with_other_face = c.origin;
      put_other_face(c.with_other_face, cell, c.of);
    }
    return c.with_other_face;
  }
  // The slot that a cell tells of, where there is one; with those before it makes the cell's values.
  Int4 find(int number, int cell, const Int4& where) {
    CellSlot& c = by_cell[cell];
    if (!std::exchange(c.looked, true)) {
      Int4 counts[kCells] = {};
      c.of = counts[cell] = begin(cell, near, c.origin);
      for (int i = 0; i < (slot.is_plane() ? 1 : kSteps) && any(c.of); ++i)
        improve(c.origin, counts, all4(kUnlimited));
    }
    const Int4 of = c.of & where;
    if (!any(of)) return of;
    put(number, c.origin, of);
    const Int4 found = explain(number + 1, cell, of), open = of & ~found;
    if (slot.edge().draws() || !any(open)) return found;
    put(number, other_face(cell), open);
    return found | explain(number + 1, cell, open);
  }
};

// What is covered by where slots are.
void ContactModel::cover_by(const Slots& slots, const Int4& one, const Int4& two,
                            Lanes& s) noexcept {
  const CutOfPieces& cut = slots.cut;
  const auto border_of = [&](int, const Parts::Part& part) {
    const Float4 x = all4(part.x), y = all4(part.y), wide = 1 + cut.axes.widening * x;
    const SweptSlot::Place at = slots.place(x, y);
    SweptSlot::Sample g = slots.sample(1, at);
    if (any(two)) g.replace(two, slots.sample(2, at));
    const auto along = [&](const SweptSlot::Place& way) {
      return g.gradient.l * way.l + g.gradient.h * way.h;
    };
    return Borders{g.value,
                   part.half_along * along(slots.along + cut.axes.widening * y * slots.around +
                                           2 * x * slots.bent_along),
                   part.half_around * along(wide * slots.around + 2 * y * slots.bent_around)};
  };
  const Int4 where = one | two;
  Parts(border_of).cover(cut, where, kThinSlot * cut.voxel, s);
  s.stays = where ? all4(kUnlimited) : s.stays, s.holds = where ? all4(kUnlimited) : s.holds;
}

// Pieces of which one slot or two are all that there is; the others are left. `far`: their middles, so far ahead that
// the bur's own print is `from_print` (mm) away.
Int4 ContactModel::cover_by_slots(const Scan& scan, const CutOfPieces& cut, const Place& far,
                                  const Float4& from_print, const Int4& wanted,
                                  Lanes& s) const noexcept {
  Slots slots(scan, cut, *slot_, far, from_print);
  const Float4 rim = cut.half_along + cut.half_around;
  slots.read(0, Float4{}, Float4{}, wanted);
  const auto found = [&](const Int4& where) {
    for (int p = 0; p < kPieces; ++p)
      if (wanted[p] && !where[p])
        (*s.slots_from)[p] = way_ + kNoSlots * static_cast<double>(cut.voxel);
    return where;
  };
  Int4 left = wanted & slots.may_be_near(0, rim);
  if (!any(left)) return found(Int4{});
  const auto read_four = [&](int from, const Float4& x, const Float4& y) {
    for (int k = 0; k < 4; ++k) slots.read(from + k, k & 1 ? x : -x, k & 2 ? y : -y, left);
  };
  read_four(1, all4(kNearCorner), all4(kNearCorner));
  Int4 others{};  // than the print
  for (int cell = 0; cell < kCellsInPiece; ++cell) others |= slots.is_other(cell);
  left &= others;
  if (!any(left)) return found(Int4{});
  slots.near = left;
  bool has_all = false;
  const auto read_all = [&] {
    if (!has_all)
      read_four(kCellsInPiece, all4(1 + kBeyondCorner * cut.voxel / cut.half_along),
                1 + kBeyondCorner * cut.voxel / cut.half_around);
    has_all = true;
  };
  const Int4 own = slots.are_in_own_slot(left);
  Int4 one = own, two{};
  left &= ~one;
  Int4 tried{};  // with another first slot: twice is enough
  for (int cell = 0; cell < kCells && any(left); ++cell) {
    if (cell == kCellsInPiece) read_all();
    const Int4 first = slots.find(0, cell, left);
    if (!any(first)) continue;
    Int4 counts[kCells] = {}, alone = first;
    for (int c = 0; c < kCellsInPiece; ++c)
      counts[c] = c == cell ? first : slots.explain(1, c, first), alone &= counts[c];
    slots.improve(slots.origin[0], counts, all4(kUnlimited));
    alone |= slots.explain(1, first & ~alone);
    alone |= slots.leaves_nothing(first & ~alone);
    slots.put_other_face(slots.origin[0], cell, first & ~alone);
    alone |= slots.explain(1, first & ~alone);
    one |= alone, left &= ~alone;
    Int4 open = first & left;
    if (any(open)) read_all();
    for (int other = 0; other < kCells && any(open); ++other) {
      Int4 both = slots.find(1, other, open & ~counts[other]);
      const Int4 partly = both;
      if (any(both)) both = slots.explain(2, both);
      slots.put(1, slots.other_face(other), partly & ~both);
      both |= slots.explain(2, partly & ~both);
      two |= both, left &= ~both, open &= ~both;
    }
    left &= ~(first & tried);
    tried |= first;
  }
  // What one piece can't tell another may.
  for (int p = 0; p < kPieces; ++p) {
    Int4 open = slots.near & ~(one | two);
    if (!(one | two)[p] || !any(open)) continue;
    slots.take_over(p, open);
    one |= slots.explain(1, open), one |= slots.leaves_nothing(open & ~one);
    if (two[p]) two |= slots.explain(2, open & ~one);
  }
  const auto reach_here = [&](int count, const Int4& where) {
    const Float4 value = slots.sample(count, slots.place(Float4{}, Float4{})).value;
    return reaches_here(scan, far, value, where, s);
  };
  one = reach_here(1, own | slots.hold_here(1, s, one & ~own));
  two = reach_here(2, slots.hold_here(2, s, two));
  if (any(one | two)) cover_by(slots, one, two, s);
  return found(one | two);
}

}  // namespace toothprep
