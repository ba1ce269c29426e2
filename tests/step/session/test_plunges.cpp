// Plunges onto the floor of an earlier slot, from the air above it: nothing is felt until the floor is met, and all of it
// from there on. And passes across an earlier slot, and through a hole.
#include "passes.h"
#include "underside.h"

namespace toothprep::testing {
namespace {

constexpr double kSlot = 0.3, kPlunge = 0.1;  // mm deep, the second below the first
constexpr double kAbove = 0.1;                // mm over the block

struct Plunge {
  const char *slot, *bur;
  double aside;  // mm, of the slot's middle
};

// mJ, of the enamel that the plunge newly takes: what lies above the bur's underside and below the slot's.
double energy_of(const Plunge& p) {
  const Underside slot(make_bur(p.slot, "")), bur(make_bur(p.bur, ""));
  const double radius = bur.radius(), step = radius / 600;
  double volume = 0;
  for (double z = -radius + 0.5 * step; z < radius; z += step)
    for (double x = -radius + 0.5 * step; x < radius; x += step) {
      const double r = std::hypot(x, z), across = std::abs(z + p.aside);
      if (r >= radius) continue;
      const double before = across < slot.radius() ? kSlot - slot.at(across) : 0;
      volume += step * step * std::max(0.0, kSlot + kPlunge - bur.at(r) - std::max(before, 0.0));
    }
  return 300 * volume;
}

double work_of(const Plunge& p, double voxel, bool way_is_known) {
  const Bur slot = make_bur(p.slot, ""), bur = make_bur(p.bur, "");
  LayeredTooth tooth = block(voxel, 2, Vec3(kLength, 2, 4));
  const Quat q = upright_leant(0, 0);
  {
    Workpiece workpiece(tooth);
    HandleSample handle{0, Pose{Vec3(-kStart, -kSlot, 0), q}, kPedalButton};
    Session session(slot, workpiece, paper_without_stall(), Drive::kDirect, handle);
    StepRecord last;
    for (; handle.pose.position.x() < kStart; handle.pose.position.x() += 8e-3, handle.time += 1e-3)
      last = session.step(handle);
    session.finish(last);
    apply_cut(tooth, workpiece);
  }
  if (!way_is_known) tooth.parts->way.reset();
  Workpiece workpiece(tooth);
  HandleSample handle{0, Pose{Vec3(0, kAbove, p.aside), q}, kPedalButton};
  Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, handle);
  const int steps = 2000;  // of 0.25 um: the step in which the floor is met doesn't count
  for (int i = 1; i <= steps; ++i) {
    handle.time += 1e-3;
    handle.pose.position.y() = kAbove - (kAbove + kSlot + kPlunge) * i / steps;
    session.step(handle);
  }
  return session.totals().torque_work;
}

TEST(Plunges, OntoTheFloorOfAnEarlierSlotTakeTheirEnergy) {
  const char *flat = "cylinder:D1.2xL4.0", *thin = "cylinder:D1.0xL4.0",
             *round = "cylinder:D1.2xL4.0xR0.3", *ball = "ball:D1.2", *taper = "taper:D1.4xL4.0xA4";
  for (const Plunge& p : {Plunge{flat, flat, 0}, Plunge{flat, flat, 0.35}, Plunge{flat, thin, 0},
                          Plunge{round, round, 0}, Plunge{round, round, 0.35},
                          Plunge{round, flat, 0.1}, Plunge{ball, ball, 0}, Plunge{ball, ball, 0.35},
                          Plunge{taper, taper, 0}, Plunge{ball, flat, 0}, Plunge{flat, ball, 0.2}})
    for (const double voxel : {0.1, 0.05, 0.025})
      for (const bool way_is_known : {true, false}) {
        const double energy = energy_of(p), work = work_of(p, voxel, way_is_known),
                     of_slot = kLength * 300 * kSlot * 2 * make_bur(p.slot, "").max_radius();
        std::printf("%-24s %-28s aside %.2f, %.3f mm, %s: %.4f of %7.3f mJ (%+.3f)\n", p.slot,
                    p.bur, p.aside, voxel, way_is_known ? "known" : "by the lattice", work / energy,
                    energy, work - energy);
        const bool coarse = voxel > 0.07;
        const double of_plunge = coarse ? (way_is_known ? 0.01 : 0.02) : 0.005;
        EXPECT_NEAR(work, energy,
                    std::max(of_plunge * energy, (coarse ? 0.002 : 0.0005) * of_slot));
      }
}

// Down to `tip` with the motor on, or to a place above it with the motor off; then on straight.
struct Leg {
  Vec3 to;
  bool cuts;
};
// mJ, of the last leg.
double work_of_last(const std::vector<Leg>& legs, double voxel) {
  const Bur bur = make_bur("cylinder:D1.2xL4.0", "");
  const LayeredTooth tooth = block(voxel, 2, Vec3(6, 2, 6));
  Workpiece workpiece(tooth);
  HandleSample handle{0, Pose{legs.front().to, upright_leant(0, 0)}, kPedalButton};
  Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, handle);
  double before = 0;
  for (const Leg& leg : legs) {
    before = session.totals().torque_work;
    handle.buttons = leg.cuts ? kPedalButton : 0;
    const Vec3 from = handle.pose.position;
    const int steps = std::max(1, static_cast<int>(std::ceil((leg.to - from).norm() / 8e-4)));
    for (int i = 1; i <= steps; ++i) {
      handle.time += 1e-3;
      handle.pose.position = from + (leg.to - from) * i / steps;
      session.step(handle);
    }
  }
  return session.totals().torque_work - before;
}

void expect_work(const char* what, const std::vector<Leg>& legs, double energy, double of_slot) {
  for (const double voxel : {0.1, 0.05, 0.025}) {
    const double work = work_of_last(legs, voxel);
    std::printf("%s, %.3f mm: %.4f of %.3f mJ (%+.3f)\n", what, voxel, work / energy, energy,
                work - energy);
    const bool coarse = voxel > 0.07;
    EXPECT_NEAR(work, energy,
                std::max((coarse ? 0.01 : 0.005) * energy, (coarse ? 0.002 : 0.0005) * of_slot))
        << what << ", " << voxel << " mm";
  }
}

// The walls that are met head-on are hidden by the bur's own print where it hardly advances, and the earlier slot's floor
// lies as deep as the bur's end: it is as good as its own slot, but for what stands in between.
TEST(Crossings, IntoAnEarlierSlotThatIsAsDeepTakeWhatStandsBeforeIt) {
  constexpr double kDeep = 0.326, kR = 0.6, kFrom = 1.2, kEnd = 0.1, kMiddle = -0.222;
  // All that the pass sweeps before the slot's wall, but for where it began.
  const double energy =
                   300 * kDeep * (2 * kR * (kFrom - kMiddle - kR) - 0.5 * units::kPi * kR * kR),
               of_slot = 300 * kDeep * 2 * kR * (kFrom - kEnd);
  expect_work("into a slot",
              {{Vec3(-2, 0.1, kMiddle), false},
               {Vec3(-2, -kDeep, kMiddle), true},
               {Vec3(2, -kDeep, kMiddle), true},
               {Vec3(2, 0.1, kMiddle), false},
               {Vec3(0.27, 0.1, kFrom), false},
               {Vec3(0.27, -kDeep, kFrom), true},
               {Vec3(0.27, -kDeep, kEnd), true}},
              energy, of_slot);
}

TEST(Crossings, ThroughAHoleTakeWhatStandsAroundIt) {
  constexpr double kDeep = 0.4, kHole = 0.25, kR = 0.6, kFrom = 1.3, kEnd = -0.7;
  const double energy = 300 * (kDeep * 2 * kR * (kFrom - kEnd) - kHole * units::kPi * kR * kR);
  expect_work("through a hole",
              {{Vec3(0, 0.1, 0), false},
               {Vec3(0, -kHole, 0), true},
               {Vec3(0, 0.1, 0), false},
               {Vec3(0, 0.1, kFrom), false},
               {Vec3(0, -kDeep, kFrom), true},
               {Vec3(0, -kDeep, kEnd), true}},
              energy, 300 * kDeep * 2 * kR * (kFrom - kEnd));
}

}  // namespace
}  // namespace toothprep::testing
