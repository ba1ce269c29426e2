// The burs that the tests of this module run over, and the exact values of simple heads.
#pragma once

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/units.h"

namespace toothprep::testing {

inline std::string library_folder() { return std::string(TOOTHPREP_SOURCE_DIR) + "/data/burs"; }

// Reproducible on every standard library, unlike std::uniform_real_distribution.
class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double within(double low, double high) {
    return low + (high - low) * (static_cast<double>(engine_()) / 4294967296.0);
  }

 private:
  std::mt19937 engine_;
};

// Shapes no catalogue has but the geometry must stand: a concave fillet, an arc beyond 180 degrees
// (a ball on a stem), a nearly flat arc of 500 mm radius, a head that overhangs (two z ranges at
// one r), a worn polyline.
inline std::vector<Bur> odd_burs() {
  std::vector<Bur> burs;
  burs.emplace_back(
      "fillet",
      std::vector<ProfilePiece>{line_piece(0, 0, 0.3, 0), line_piece(0.3, 0, 0.3, 1),
                                arc_piece(0.3, 1, 0.7, 1.4, 0.7, 1.0, false),
                                line_piece(0.7, 1.4, 0.7, 2), line_piece(0.7, 2, 0, 2, false)},
      0.4, 5);
  {  // centre (0.4, 0.6), radius 0.6: from the axis round the outside and back to r = 0.2
    const double k = std::sqrt(0.36 - 0.04);
    burs.emplace_back("bulge",
                      std::vector<ProfilePiece>{
                          line_piece(0, 0, 0.4, 0), arc_piece(0.4, 0, 0.2, 0.6 + k, 0.4, 0.6),
                          line_piece(0.2, 0.6 + k, 0.2, 2), line_piece(0.2, 2, 0, 2, false)},
                      0, 0);
    burs.emplace_back(
        "ring",  // hollow at the tip: starts on the axis above the rim would be refused, so a
                 // dimple of arcs
        std::vector<ProfilePiece>{arc_piece(0, 0, 0.1, 0.1, 0, 0.1),
                                  arc_piece(0.1, 0.1, 0.4, 0.1, 0.25, 0.1, false),
                                  arc_piece(0.4, 0.1, 0.5, 0.2, 0.4, 0.2),
                                  line_piece(0.5, 0.2, 0.5, 1), line_piece(0.5, 1, 0, 1, false)},
        0, 0);
  }
  burs.emplace_back(
      "flat-arc",
      std::vector<ProfilePiece>{line_piece(0, 0, 0.5, 0),
                                arc_piece(0.5, 0, 0.5, 4, 0.5 - std::sqrt(500.0 * 500.0 - 4.0), 2),
                                line_piece(0.5, 4, 0, 4, false)},
      0, 0);
  burs.emplace_back("overhang",
                    std::vector<ProfilePiece>{
                        line_piece(0, 0, 0.2, 0.4), line_piece(0.2, 0.4, 0.2, 1.0),
                        line_piece(0.2, 1.0, 0.8, 0.5), line_piece(0.8, 0.5, 0.9, 2.0),
                        line_piece(0.9, 2.0, 0.3, 1.5), line_piece(0.3, 1.5, 0, 2.2, false)},
                    0, 0);
  std::vector<ProfilePiece> worn = {line_piece(0, 0, 0.4, 0.02)};
  for (int i = 1; i <= 40; ++i) {
    const double r = 0.6 - 0.2 * std::exp(-i / 8.0) + 0.004 * (i % 3), z = 0.02 + 0.1 * i;
    worn.push_back(line_piece(worn.back().r1, worn.back().z1, r, z));
  }
  worn.push_back(line_piece(worn.back().r1, worn.back().z1, 0, worn.back().z1, false));
  burs.emplace_back("worn", worn, 0.4, 10);
  return burs;
}

inline std::vector<Bur> all_burs() {
  std::vector<Bur> burs = odd_burs();
  for (const LibraryEntry& entry : list_library(library_folder()))
    burs.push_back(make_bur(entry.name, library_folder()));
  for (const char* shape :
       {"cone:D1.6xL4.0xT0", "cone:D1.6xL4.0xT0.8xR0.2", "cylinder:D1.2xL3.0xR0.25",
        "inverted-cone:D1.4xL1.2xN0.8xR0.1", "pear:D1.0xL2.0xN0.5", "taper:D1.2xL5.0xA3",
        "flame:D1.0xL5.0", "torpedo:D1.2xL6.0", "round-cylinder:D1.2xL0.6",
        "torpedo:D1.0xL2.0xB0.5"})
    burs.push_back(make_bur(shape, ""));
  return burs;
}

}  // namespace toothprep::testing
