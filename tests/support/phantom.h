// A tooth known exactly, and its CT: concentric balls, or an enamel cap over a dentin root with
// pulp.
//
// The scan is a sum of blurred steps, one per border: a step of height c over a border at signed
// distance d (negative inside), blurred by a Gaussian of width sigma, is c * Phi(-d / sigma),
// exactly so for a plane and to second order of sigma / radius for a curved border. Regions are
// nested (tooth, then what is under the enamel, then pulp), and at the root the second border lies
// on the first, so the steps add up.
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <random>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/io/image_volume.h"

namespace toothprep::phantom {

struct Distances {
  double tooth = 0, core = 0, pulp = 0;  // signed, mm, negative inside; core: all but the enamel
};
using Anatomy = std::function<Distances(const Vec3&)>;

inline double capsule(const Vec3& x, double from_z, double to_z, double radius) {
  const double z = std::min(std::max(x.z(), from_z), to_z);
  return (x - Vec3(0, 0, z)).norm() - radius;
}

// Concentric balls.
inline Anatomy balls(double tooth, double core, double pulp, const Vec3& centre = Vec3::Zero()) {
  return [=](const Vec3& x) {
    const double r = (x - centre).norm();
    return Distances{r - tooth, r - core, r - pulp};
  };
}

// A round-ended peg of radius 3.2 mm, 13.4 mm tall; above z = 0 it is covered by 0.9 mm of enamel.
// A pulp chamber of radius 1 mm with a canal of radius 0.35 mm that ends at z = canal_end (the peg
// ends at -9.2: beyond it the apex is open).
inline Anatomy peg(double canal_end = -6) {
  return [=](const Vec3& x) {
    Distances d;
    d.tooth = capsule(x, -6, 1, 3.2);
    d.core = std::min(capsule(x, -6, 1, 2.3), std::max(d.tooth, x.z()));
    d.pulp = std::min(capsule(x, -0.8, 0.4, 1.0), capsule(x, canal_end, 0, 0.35));
    return d;
  };
}

inline Tissue label_at(const Distances& d) {
  if (d.tooth >= 0) return Tissue::kAir;
  if (d.pulp < 0) return Tissue::kPulp;
  return d.core < 0 ? Tissue::kDentin : Tissue::kEnamel;
}

struct Grey {
  double surroundings = 80, dentin = 160, enamel = 235, pulp = 20;
};

struct Scanner {
  double spacing = 0.2;  // mm
  double blur = 0.14;    // sigma, mm
  double noise = 0;      // standard deviation, grey values
  Mat3 direction = Mat3::Identity();
  Grey grey;
  unsigned seed = 1;
};

inline ImageVolume<float> scan_of(const Anatomy& anatomy, const Vec3& low, const Vec3& high,
                                  const Scanner& scanner) {
  ImageVolume<float> image;
  image.spacing = Vec3::Constant(scanner.spacing);
  image.direction = scanner.direction;
  // A box about the same centre that holds low..high whatever its axes.
  const Vec3 centre = 0.5 * (low + high);
  Vec3 half = 0.5 * (high - low);
  if (!scanner.direction.cwiseAbs().isIdentity(1e-12))
    half = scanner.direction.transpose().cwiseAbs() * half;
  image.size = (2 * half / scanner.spacing).array().ceil().cast<int>() + 1;
  image.origin = centre - scanner.direction * (0.5 * scanner.spacing *
                                               (image.size - Index3::Ones()).cast<double>());
  image.data.resize(static_cast<std::size_t>(image.size.prod()));
  std::mt19937 random(scanner.seed);
  std::normal_distribution<double> noise(0, 1);
  const auto step = [&](double d) { return 0.5 * std::erfc(d / (scanner.blur * std::sqrt(2.0))); };
  const Grey& g = scanner.grey;
  std::size_t v = 0;
  for (int k = 0; k < image.size.z(); ++k)
    for (int j = 0; j < image.size.y(); ++j)
      for (int i = 0; i < image.size.x(); ++i, ++v) {
        const Distances d = anatomy(image.to_world(Vec3(i, j, k)));
        // An open canal is full of what surrounds the tooth below its mouth.
        const double grey = g.surroundings + (g.enamel - g.surroundings) * step(d.tooth) +
                            (g.dentin - g.enamel) * step(std::max(d.core, d.tooth)) +
                            (g.pulp - g.dentin) * step(std::max(d.pulp, d.tooth));
        image.data[v] = static_cast<float>(grey + scanner.noise * noise(random));
      }
  return image;
}

}  // namespace toothprep::phantom
