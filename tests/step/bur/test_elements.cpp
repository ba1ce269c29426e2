// The surface elements against areas, volumes and force sums with a closed form.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <vector>

#include "bur_cases.h"
#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

using testing::all_burs;
using units::kPi;

double sum(const std::vector<float>& v) { return std::accumulate(v.begin(), v.end(), 0.0); }

// Floats carry 2^-24 = 6e-8 each; sums of positive ones no more, relatively.
constexpr double kFloat = 2e-7;

TEST(BurArea, OfSimpleHeadsIsTheTextbookFormula) {
  const double R = 0.6, L = 3.0;
  EXPECT_NEAR(make_bur("cylinder:D1.2xL3.0", "").grinding_area(), kPi * R * R + 2 * kPi * R * L,
              1e-12);
  EXPECT_NEAR(make_bur("ball:D1.2", "").grinding_area(), 4 * kPi * R * R, 1e-12);
  EXPECT_NEAR(make_bur("round-cylinder:D1.2xL3.0", "").grinding_area(),
              2 * kPi * R * R + 2 * kPi * R * (L - R), 1e-12);
  const double t = 0.3;  // cone: frustum's mantle pi (R + t) slant, and the tip's disc
  EXPECT_NEAR(make_bur("cone:D1.2xL3.0xT0.6", "").grinding_area(),
              kPi * (R + t) * std::hypot(L, R - t) + kPi * t * t, 1e-12);
}

TEST(BurVolume, OfSimpleHeadsIsTheTextbookFormula) {
  const double R = 0.6, L = 3.0, t = 0.3;
  EXPECT_NEAR(make_bur("cylinder:D1.2xL3.0", "").head_volume(), kPi * R * R * L, 1e-12);
  EXPECT_NEAR(make_bur("ball:D1.2", "").head_volume(), 4 * kPi / 3 * R * R * R, 1e-12);
  EXPECT_NEAR(make_bur("round-cylinder:D1.2xL3.0", "").head_volume(),
              2 * kPi / 3 * R * R * R + kPi * R * R * (L - R), 1e-12);
  EXPECT_NEAR(make_bur("cone:D1.2xL3.0xT0.6", "").head_volume(),
              kPi * L / 3 * (R * R + R * t + t * t), 1e-12);
}

TEST(BurElements, AreasAndWeightsSumToTheAnalyticValuesWhateverTheSize) {
  for (const Bur& bur : all_burs()) {
    double length = 0;
    for (const ProfilePiece& piece : bur.profile())
      if (piece.grinds) length += length_of(piece);
    for (const double size : {0.31, 0.1, 0.037}) {
      const SurfaceElements e = bur.elements(size);
      EXPECT_NEAR(sum(e.area) / bur.grinding_area(), 1, kFloat) << bur.name() << ", size " << size;
      EXPECT_NEAR(sum(e.weight) / (2 * kPi * length), 1, kFloat) << bur.name() << ", size " << size;
    }
  }
}

TEST(BurElements, LieOnTheSurfaceWithAnOrthonormalFrameAndWithinTheSize) {
  for (const Bur& bur : all_burs()) {
    const double size = 0.1;
    const SurfaceElements e = bur.elements(size);
    ASSERT_EQ(e.nx.size(), e.size());
    ASSERT_EQ(e.half_around.size(), e.size());
    double off = 0, frame = 0, slope = 0;
    for (std::size_t i = 0; i < e.size(); ++i) {
      const Vec3 x(e.x[i], e.y[i], e.z[i]), n(e.nx[i], e.ny[i], e.nz[i]), t(e.tx[i], e.ty[i], 0);
      const Vec3 l(e.lx[i], e.ly[i], e.lz[i]);
      const double r = std::hypot(x.x(), x.y());
      off = std::max({off, std::abs(bur.distance(r, x.z())), std::abs(r - e.radius[i])});
      Mat3 m;
      m << n, t, l;
      frame = std::max(frame, (m.transpose() * m - Mat3::Identity()).cwiseAbs().maxCoeff());
      // Clockwise: t is +phi^, and (t, l, n) turns like (phi^, up, outward) on a cylinder: t x l =
      // n.
      EXPECT_GT(t.dot(Vec3(-x.y(), x.x(), 0)), 0);
      EXPECT_GT(t.cross(l).dot(n), 0.99);
      // The distance grows along the normal: n points out of the head.
      const Vec3 out = x + 1e-3 * n;
      slope = std::max(slope, std::abs(bur.distance(std::hypot(out.x(), out.y()), out.z()) - 1e-3));
      EXPECT_LE(2 * e.half_along[i], size * (1 + kFloat));
      EXPECT_LE(2 * e.half_around[i], size * (1 + kFloat));
      EXPECT_GT(e.radius[i], 0);
    }
    EXPECT_LT(off, 2e-6) << bur.name();  // float coordinates up to 10 mm
    EXPECT_LT(frame, 1e-6) << bur.name();
    EXPECT_LT(slope, 2e-6) << bur.name();
  }
}

TEST(BurElements, CurvaturesAreThoseOfTheDistanceFunction) {
  // On a surface of revolution the Hessian of the distance has the principal curvatures as
  // eigenvalues: around the axis d_r / r, along the profile d_rr + d_zz. Central differences over h
  // err by about h^2 curvature^2.
  const double h = 1e-3;
  for (const Bur& bur : all_burs()) {
    const SurfaceElements e = bur.elements(0.1);
    ASSERT_EQ(e.curvature_along.size(), e.size());
    for (std::size_t i = 0; i < e.size(); ++i) {
      if (e.half_along[i] < 5 * h || e.radius[i] < 5 * h)
        continue;  // too near to an edge or the axis
      const double r = e.radius[i], z = e.z[i];
      const auto d = [&](double dr, double dz) { return bur.distance(r + dr, z + dz); };
      const double along = (d(h, 0) + d(-h, 0) + d(0, h) + d(0, -h) - 4 * d(0, 0)) / (h * h);
      const double around = (d(h, 0) - d(-h, 0)) / (2 * h * r);
      // Floats place the element off the surface by 1e-7 or so, which doesn't matter to curvatures.
      EXPECT_NEAR(e.curvature_along[i], along, 1e-3 * (1 + std::abs(along))) << bur.name();
      EXPECT_NEAR(e.curvature_around[i], around, 1e-3 * (1 + std::abs(around))) << bur.name();
    }
  }
}

TEST(BurElements, RunInRingsFromTipToShankWithAtLeastEightInEach) {
  const Bur bur = make_bur("round-cylinder:D1.2xL3.0", "");
  const SurfaceElements e = bur.elements(0.1);
  std::size_t i = 0;
  float last_z = -1;
  while (i < e.size()) {
    std::size_t ring = i;
    double turned = 0;
    while (ring < e.size() && e.z[ring] == e.z[i] && e.radius[ring] == e.radius[i]) {
      if (ring > i) {
        const double step = std::atan2(e.x[ring - 1] * e.y[ring] - e.y[ring - 1] * e.x[ring],
                                       e.x[ring - 1] * e.x[ring] + e.y[ring - 1] * e.y[ring]);
        EXPECT_GT(step, 0);
        turned += step;
      }
      ++ring;
    }
    EXPECT_GE(ring - i, 8u);
    EXPECT_EQ((ring - i) % 4, 0u);
    EXPECT_LT(turned, 2 * kPi);
    EXPECT_GT(e.z[i], last_z);
    last_z = e.z[i];
    i = ring;
  }
}

TEST(BurElements, OfACounterClockwiseBurHaveTheOppositeTangentAndNothingElseChanged) {
  const Bur bur = make_bur("taper:D1.2xL5.0xA3", "");
  const SurfaceElements a = bur.elements(0.1, true), b = bur.elements(0.1, false);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a.tx[i], -b.tx[i]);
    EXPECT_EQ(a.ty[i], -b.ty[i]);
  }
  EXPECT_EQ(a.nx, b.nx);
  EXPECT_EQ(a.lx, b.lx);
  EXPECT_EQ(a.weight, b.weight);
}

TEST(BurElements, AreTheSameSetToTheLastBitAfterAQuarterTurn) {
  const SurfaceElements e = make_bur("flame:D1.0xL5.0", "").elements(0.07);
  std::size_t i = 0;
  while (i < e.size()) {
    std::size_t end = i;
    while (end < e.size() && e.z[end] == e.z[i]) ++end;
    const std::size_t quarter = (end - i) / 4;
    for (std::size_t k = i; k + quarter < end; ++k) {
      EXPECT_EQ(e.x[k + quarter], -e.y[k]);
      EXPECT_EQ(e.y[k + quarter], e.x[k]);
      EXPECT_EQ(e.nx[k + quarter], -e.ny[k]);
      EXPECT_EQ(e.tx[k + quarter], -e.ty[k]);
    }
    i = end;
  }
}

// Errors at sizes h and h/2: second order means a quarter; rounding bounds it from below.
void expect_second_order(const std::function<double(double)>& error, const std::string& what) {
  const double coarse = std::abs(error(0.1)), fine = std::abs(error(0.05)),
               finest = std::abs(error(0.025));
  EXPECT_LT(fine, 0.34 * coarse + 2 * kFloat) << what;
  EXPECT_LT(finest, 0.34 * fine + 2 * kFloat) << what;
  EXPECT_LT(finest, 2e-3) << what;
}

TEST(BurElements, FluxOfThePositionIsThreeTimesTheVolume) {
  // Divergence theorem: sum of x.n area / 3 over the closed surface. Pieces that don't grind are
  // discs z = const here, whose share is z r^2 pi / 3 exactly.
  for (const Bur& bur : all_burs()) {
    if (bur.name() == "overhang") continue;  // its closing piece is no disc
    double caps = 0;
    for (const ProfilePiece& piece : bur.profile())
      if (!piece.grinds) caps += piece.z0 * kPi * piece.r0 * piece.r0 / 3;
    expect_second_order(
        [&](double size) {
          const SurfaceElements e = bur.elements(size);
          double flux = 0;
          for (std::size_t i = 0; i < e.size(); ++i)
            flux +=
                (double(e.x[i]) * e.nx[i] + double(e.y[i]) * e.ny[i] + double(e.z[i]) * e.nz[i]) *
                e.area[i];
          return (flux / 3 + caps) / bur.head_volume() - 1;
        },
        bur.name());
  }
}

// The sums over the advancing surface that Eqs 8 and 9 are made of, for unit speed along `feed`.
struct Sums {
  Vec3 normal = Vec3::Zero();   // sum of weight (n.v) n
  Vec3 tangent = Vec3::Zero();  // sum of weight (n.v) t
  double area = 0;              // sum of area (n.v): the volume swept per length of feed
};

Sums sums(const Bur& bur, double size, Vec3 feed, bool clockwise = true) {
  feed.normalize();
  const SurfaceElements e = bur.elements(size, clockwise);
  Sums s;
  for (std::size_t i = 0; i < e.size(); ++i) {
    const Vec3 n(e.nx[i], e.ny[i], e.nz[i]), t(e.tx[i], e.ty[i], 0);
    const double advance = n.dot(feed);
    if (advance <= 0) continue;
    s.normal += e.weight[i] * advance * n;
    s.tangent += e.weight[i] * advance * t;
    s.area += e.area[i] * advance;
  }
  return s;
}

// A ring of n equal steps integrates max(cos, 0) with a relative error of at most 2 (1/(n^2-1) +
// 1/(4n^2-1) +
// ...), about pi^2 / (3 n^2): its Fourier series has the terms 2/(k^2-1) of the mean at even k, of
// which the multiples of n are mistaken for the mean. With steps of at most h on the radius r that
// is (h/r)^2 / 12. (The phase of the feed between two elements decides how much of it shows, so
// that successive errors need not fall monotonically.) max(cos, 0) cos, of the force sums, has no
// even terms beyond 2: any even n integrates it exactly.
double ring_bound(double h, double r) { return h * h / (12 * r * r); }

TEST(ForceSums, OfACylinderFedSidewaysAreHalfPiLAndTwoRL) {
  // Side: n = (cos, sin, 0), dphi dl. Integral of cos^2 over the advancing half turn is pi/2, times
  // L; t gives the same across, z^ x feed. Swept area per length: the shadow 2 R L. The flat end
  // has n.v = 0.
  const double R = 0.6, L = 3.0;
  const Bur bur = make_bur("cylinder:D1.2xL3.0", "");
  for (const double angle : {0.0, 0.3, 2.0, 4.5}) {
    const Vec3 feed(std::cos(angle), std::sin(angle), 0), across = Vec3::UnitZ().cross(feed);
    for (const double h : {0.2, 0.1, 0.05, 0.025}) {
      const Sums s = sums(bur, h, feed);
      EXPECT_NEAR(s.normal.dot(feed) / (kPi / 2 * L), 1, kFloat) << "size " << h;
      EXPECT_NEAR(s.tangent.dot(across) / (kPi / 2 * L), 1, kFloat) << "size " << h;
      EXPECT_NEAR(s.normal.dot(across), 0, 1e-6 * L);
      EXPECT_NEAR(s.tangent.dot(feed), 0, 1e-6 * L);
      EXPECT_NEAR(s.area / (2 * R * L), 1, ring_bound(h, R) + kFloat) << "size " << h;
      EXPECT_NEAR(sums(bur, h, feed, false).tangent.dot(across), -kPi / 2 * L, kFloat * 5);
    }
  }
}

TEST(ForceSums, OfABallFedAcrossItsAxis) {
  // n = (sin a cos, sin a sin, cos a), dl = R da. Normal: R integral sin^2 a da (pi/2) = pi^2 R /
  // 4, exact for equal steps of a. Tangent: R integral sin a da (pi/2) = pi R, for steps da too
  // large by da^2 / 24. Shadow: pi R^2; the rings' bounds (h / (R sin a))^2 / 12, weighted by their
  // share sin^2 a, average to (h/R)^2 / 6.
  const double R = 0.6;
  const Bur bur = make_bur("ball:D1.2", "");
  const Vec3 feed(std::cos(0.7), std::sin(0.7), 0), across = Vec3::UnitZ().cross(feed);
  for (const double h : {0.2, 0.1, 0.05, 0.025}) {
    const Sums s = sums(bur, h, feed);
    EXPECT_NEAR(s.normal.dot(feed) / (kPi * kPi * R / 4), 1, kFloat) << "size " << h;
    const double da = kPi / std::ceil(kPi * R / h - 1e-9);
    EXPECT_NEAR(s.tangent.dot(across) / (kPi * R), 1 + da * da / 24, 0.01 * da * da + kFloat)
        << "size " << h;
    EXPECT_NEAR(s.area / (kPi * R * R), 1, 2 * ring_bound(h, R) + kFloat) << "size " << h;
  }
  expect_second_order(
      [&](double h) { return sums(bur, h, feed).tangent.dot(across) / (kPi * R) - 1; }, "across");
}

TEST(ForceSums, OfAFlatEndPlungingAlongTheAxisAreTwoPiRAndPiRSquared) {
  // n = -z^ everywhere: weight 2 pi per length of radius, shadow pi R^2, tangents cancel around the
  // axis.
  const double R = 0.6;
  const Sums s = sums(make_bur("cylinder:D1.2xL3.0", ""), 0.05, -Vec3::UnitZ());
  EXPECT_NEAR(s.normal.dot(-Vec3::UnitZ()), 2 * kPi * R, 1e-6);
  EXPECT_NEAR(s.area, kPi * R * R, 1e-6);
  EXPECT_NEAR(s.tangent.norm(), 0, 1e-6);
}

TEST(ForceSums, GiveThePapersForcesWithItsParameters) {
  // F = u/(2 pi N) (normal/alpha against the feed, tangent across it), T = u/(2 pi N) swept:
  // PAPER's values u 300 N/mm^2, alpha 0.25, N 100 rev/s, v 0.5 mm/s. Closed forms u v L/(4 alpha
  // N), u v L/(4 N), u v R L/(pi N); ball pi u v R/(8 alpha N), u v R/(2 N), u v R^2/(2 N).
  const double u = 300, v = 0.5, alpha = 0.25, N = 100, R = 0.6, L = 3.0;
  const double factor = u * v / (2 * kPi * N);
  const Sums c = sums(make_bur("paper-cylinder", testing::library_folder()), 0.05, Vec3(0, -1, 0));
  EXPECT_NEAR(factor / alpha * c.normal.norm(), u * v * L / (4 * alpha * N), 1e-3);  // 4.5 N
  EXPECT_NEAR(factor * c.tangent.norm(), u * v * L / (4 * N), 1e-3);                 // 1.125 N
  EXPECT_NEAR(factor * c.area, u * v * R * L / (kPi * N), 1e-3);                     // 0.859 mN m
  const Sums b = sums(make_bur("paper-ball", testing::library_folder()), 0.05, Vec3(0, -1, 0));
  EXPECT_NEAR(factor / alpha * b.normal.norm(), kPi * u * v * R / (8 * alpha * N),
              1e-3);                                                  // 1.4137 N
  EXPECT_NEAR(factor * b.tangent.norm(), u * v * R / (2 * N), 1e-3);  // 0.45 N
  EXPECT_NEAR(factor * b.area, u * v * R * R / (2 * N), 1e-3);        // 0.27 mN m
}

TEST(ForceSums, SweptAreaIsTheShadowInAnyDirection) {
  // A convex head sweeps its shadow: for the cylinder 2 R L sin b + pi R^2 cos b at the angle b to
  // the axis, as long as the closing disc trails; for the ball pi R^2.
  const double R = 0.6, L = 3.0;
  const Bur cylinder = make_bur("cylinder:D1.2xL3.0", ""), ball = make_bur("ball:D1.2", "");
  for (const double b : {0.2, 0.8, 1.3}) {
    const Vec3 feed(std::sin(b) * std::cos(1.1), std::sin(b) * std::sin(1.1), -std::cos(b));
    for (const double h : {0.1, 0.05, 0.025}) {
      const double shadow = 2 * R * L * std::sin(b) + kPi * R * R * std::cos(b);
      EXPECT_NEAR(sums(cylinder, h, feed).area / shadow, 1, ring_bound(h, R) + kFloat)
          << "size " << h;
      // Elements are counted whole on either side of the line n.v = 0, where n.v is below h/R:
      // (h/R)^2 bounds it.
      EXPECT_NEAR(sums(ball, h, feed).area / (kPi * R * R), 1, h * h / (R * R)) << "size " << h;
    }
  }
}

TEST(BurElements, RefuseSizesThatAreNoSizes) {
  const Bur bur = make_bur("ball:D1.2", "");
  for (const double size : {0.0, -0.1, 1e-9, 1e9, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_THROW(static_cast<void>(bur.elements(size)), Error) << size;
    EXPECT_THROW(static_cast<void>(bur.shank_elements(size)), Error) << size;
  }
  EXPECT_THROW(static_cast<void>(make_bur("cylinder:D10xL50", "").elements(1e-3)),
               Error);  // 1.6e9 elements
}

TEST(ShankElements, AreThePlainCylinderAboveTheHead) {
  const Bur bur("b", make_bur("ball:D1.2", "").profile(), 0.3, 7.2);
  const SurfaceElements e = bur.shank_elements(0.1);
  EXPECT_NEAR(sum(e.area) / (2 * kPi * 0.3 * (7.2 - 1.2)), 1, kFloat);
  for (std::size_t i = 0; i < e.size(); ++i) {
    EXPECT_NEAR(std::hypot(e.x[i], e.y[i]), 0.3, 1e-6);
    EXPECT_GT(e.z[i], 1.2f);
    EXPECT_LT(e.z[i], 7.2f);
    EXPECT_NEAR(e.nx[i] * 0.3, e.x[i], 1e-6);
    EXPECT_NEAR(e.ny[i] * 0.3, e.y[i], 1e-6);
    EXPECT_EQ(e.nz[i], 0.0f);
  }
  EXPECT_EQ(make_bur("ball:D1.2xS0", "").shank_elements(0.1).size(), 0u);
}

}  // namespace
}  // namespace toothprep
