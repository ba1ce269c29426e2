// Walks that nobody chose: an upright bur goes along the block's axes and across, plunges, sinks on slopes, lifts off and
// comes down elsewhere. What each leg newly takes is counted on a grid. The suite goes the first eight walks; TOOTHPREP_DRAWN
// says how many (README.md in step/grinding speaks of 100).
#include <cstdlib>
#include <random>

#include "passes.h"
#include "underside.h"

namespace toothprep::testing {
namespace {

constexpr double kAir = 0.1;               // mm above the block
constexpr double kWide = 1.1, kLow = 0.9;  // mm, that walks go aside and down
constexpr double kCell = 0.0025;           // mm, of the grid
constexpr std::size_t kLegs = 15;

// Places of the tip: y upwards from the block's top face.
std::vector<Vec3> drawn_walk(std::mt19937& numbers) {
  const auto between = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(numbers()) / 4294967296.0;
  };
  const auto within = [](const Vec3& p) {
    return std::abs(p.x()) < kWide && std::abs(p.z()) < kWide && p.y() > -kLow;
  };
  std::vector<Vec3> walk = {Vec3(between(-0.8, 0.8), kAir, between(-0.8, 0.8))};
  walk.emplace_back(walk[0].x(), -between(0.15, 0.4), walk[0].z());
  while (walk.size() <= kLegs) {
    const auto kind = numbers() % 6;
    Vec3 to = walk.back();
    if (kind == 3) {
      to.y() -= between(0.05, 0.25);
    } else if (kind == 4) {
      to.y() = kAir;
      walk.push_back(to);
      to.x() = between(-0.9, 0.9), to.z() = between(-0.9, 0.9);
      walk.push_back(to);
      to.y() = -between(0.15, 0.8);
    } else {
      const double quarter = 0.5 * units::kPi,
                   angle = kind == 0 || kind == 5 ? between(0, 4 * quarter)
                                                  : quarter * static_cast<double>(numbers() % 4),
                   way = between(0.2, 1.4);
      to +=
          Vec3(way * std::cos(angle), kind == 5 ? -between(0.03, 0.15) : 0, way * std::sin(angle));
    }
    if (within(to)) walk.push_back(to);
  }
  return walk;
}

// mJ, of the enamel that the bur takes on each leg, and that it would take in whole tissue.
struct LegEnergy {
  double newly, whole;
};
std::vector<LegEnergy> energies_of(const std::vector<Vec3>& walk, const Bur& bur) {
  const Underside underside(bur);
  const double reach = kWide + underside.radius() + kCell;
  const int n = 2 * static_cast<int>(std::ceil(reach / kCell));
  std::vector<float> depth(static_cast<std::size_t>(n) * n, 0.0F), fresh(depth.size());
  const auto place = [&](int i) { return (i + 0.5) * kCell - 0.5 * n * kCell; };
  std::vector<LegEnergy> energies;
  for (std::size_t leg = 1; leg < walk.size(); ++leg) {
    const Vec3 way = walk[leg] - walk[leg - 1];
    const bool sinks = way.y() != 0 && std::hypot(way.x(), way.z()) > 0;
    const int parts = sinks ? 60 : 1;
    std::fill(fresh.begin(), fresh.end(), 0.0F);
    for (int part = 0; part < parts; ++part) {
      const Vec3 from = walk[leg - 1] + way * part / parts, along = way / parts;
      const double square = along.x() * along.x() + along.z() * along.z();
      const auto range = [&](double a, double b) {
        const double half = 0.5 * n * kCell, low = std::min(a, b) - underside.radius() + half,
                     high = std::max(a, b) + underside.radius() + half;
        return std::pair(std::clamp(static_cast<int>(low / kCell) - 1, 0, n),
                         std::clamp(static_cast<int>(high / kCell) + 2, 0, n));
      };
      const auto [x0, x1] = range(from.x(), from.x() + along.x());
      const auto [z0, z1] = range(from.z(), from.z() + along.z());
      for (int i = x0; i < x1; ++i)
        for (int k = z0; k < z1; ++k) {
          const double x = place(i) - from.x(), z = place(k) - from.z();
          float& most = fresh[static_cast<std::size_t>(i) * n + k];
          const auto take = [&](double t) {
            const double r = std::hypot(x - t * along.x(), z - t * along.z());
            if (r >= underside.radius()) return;
            const double y =
                square > 0 ? from.y() + t * along.y() : std::min(from.y(), from.y() + along.y());
            most = std::max(most, static_cast<float>(-y - underside.at(r)));
          };
          const double nearest = square > 0 ? (x * along.x() + z * along.z()) / square : 0;
          take(std::clamp(nearest, 0.0, 1.0));
          if (!sinks) continue;
          // A flat end takes most when its rim leaves, a round one before that.
          const double rim = underside.radius() - 1e-9,
                       aside = x * x + z * z - nearest * nearest * square,
                       leaves = nearest + std::sqrt(std::max(0.0, rim * rim - aside) / square);
          take(std::clamp(leaves, 0.0, 1.0));
          take(std::clamp(0.5 * (nearest + leaves), 0.0, 1.0));
        }
    }
    LegEnergy energy{0, 0};
    for (std::size_t c = 0; c < depth.size(); ++c) {
      energy.whole += double{fresh[c]};
      energy.newly += std::max(0.0, double{fresh[c]} - double{depth[c]});
      depth[c] = std::max(depth[c], fresh[c]);
    }
    energies.push_back({300 * kCell * kCell * energy.newly, 300 * kCell * kCell * energy.whole});
  }
  return energies;
}

std::vector<double> works_of(const std::vector<Vec3>& walk, const Bur& bur,
                             const LayeredTooth& tooth) {
  Workpiece workpiece(tooth);
  HandleSample handle{0, Pose{walk[0], upright_leant(0, 0)}, kPedalButton};
  Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, handle);
  std::vector<double> works;
  for (std::size_t leg = 1; leg < walk.size(); ++leg) {
    const double before = session.totals().torque_work;
    const Vec3 way = walk[leg] - walk[leg - 1];
    const int steps = static_cast<int>(std::ceil(way.norm() / 8e-4));
    for (int i = 1; i <= steps; ++i) {
      handle.time += 1e-3;
      handle.pose.position = walk[leg - 1] + way * i / steps;
      session.step(handle);
    }
    works.push_back(session.totals().torque_work - before);
  }
  return works;
}

// Each walk's worst leg over what is allowed: 1 % of its energy or 0.2 % of what it takes in whole tissue (0.3, 0.05 %
// below 0.1 mm), the step in which the bur meets something, and what the grid is off.
void expect_walks(const char* name, double voxel, double mean_at_most, double worst_at_most) {
  const Bur bur = make_bur(name, "");
  const LayeredTooth tooth = block(voxel, 2, Vec3(6, 2, 6));
  const char* asked = std::getenv("TOOTHPREP_DRAWN");
  const int count = asked ? std::atoi(asked) : 8;
  const bool coarse = voxel > 0.07;
  std::mt19937 numbers(1);
  double mean = 0, worst = 0;
  for (int walk = 0; walk < count; ++walk) {
    const std::vector<Vec3> places = drawn_walk(numbers);
    const std::vector<LegEnergy> energies = energies_of(places, bur);
    const std::vector<double> works = works_of(places, bur, tooth);
    double beyond = 0;
    std::size_t of = 0;
    for (std::size_t leg = 0; leg < works.size(); ++leg) {
      if (places[leg + 1].y() > places[leg].y()) continue;
      const auto [newly, whole] = energies[leg];
      const double allowed =
          std::max((coarse ? 0.01 : 0.003) * newly, (coarse ? 0.002 : 0.0005) * whole) +
          1e-3 * newly / (places[leg + 1] - places[leg]).norm() + 0.03;
      const double error = std::abs(works[leg] - newly) / allowed;
      if (error > beyond) beyond = error, of = leg;
    }
    std::printf("%s %.2f mm, walk %d: %.2f, leg %zu: %+.3f of %.3f mJ\n", name, voxel, walk, beyond,
                of, works[of] - energies[of].newly, energies[of].newly);
    mean += beyond / count, worst = std::max(worst, beyond);
  }
  std::printf("%s %.2f mm: mean %.2f, worst %.2f\n", name, voxel, mean, worst);
  EXPECT_LT(mean, mean_at_most) << name << ", " << voxel;
  EXPECT_LT(worst, worst_at_most) << name << ", " << voxel;
}

TEST(DrawnWalks, OfAPlainCylinderAreNearlyRightAtATenthOfAMillimetre) {
  expect_walks("cylinder:D1.2xL4.0", 0.1, 0.5, 1.3);
}
TEST(DrawnWalks, OfAPlainCylinderAreNearlyRightAtHalfOfThat) {
  expect_walks("cylinder:D1.2xL4.0", 0.05, 0.65, 1.6);
}
TEST(DrawnWalks, OfARoundedCornerAreRightAtATenthOfAMillimetre) {
  expect_walks("cylinder:D1.2xL4.0xR0.3", 0.1, 0.35, 1);
}
TEST(DrawnWalks, OfARoundedCornerAreNearlyRightAtHalfOfThat) {
  expect_walks("cylinder:D1.2xL4.0xR0.3", 0.05, 0.5, 0.9);
}

}  // namespace
}  // namespace toothprep::testing
