// The lower surface of an upright bur, for volumes below it that are counted on a grid.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "toothprep/step/bur/bur.h"

namespace toothprep::testing {

class Underside {
 public:
  explicit Underside(const Bur& bur) : radius_(bur.max_radius()) {
    for (int i = 0; i < kCount; ++i) {
      const double r = radius_ * (i + 0.5) / kCount;
      double outside = -1, inside = 0.5 * bur.head_length();
      for (int n = 0; n < 50; ++n) {
        const double middle = 0.5 * (outside + inside);
        (bur.distance(r, middle) < 0 ? inside : outside) = middle;
      }
      heights_.push_back(outside);
    }
  }
  double radius() const { return radius_; }  // mm
  // How high above the tip it is so far from the axis, less than the radius; mm.
  double at(double r) const {
    return heights_[std::min<std::size_t>(kCount - 1,
                                          static_cast<std::size_t>(r / radius_ * kCount))];
  }

 private:
  static constexpr int kCount = 600;
  double radius_;
  std::vector<double> heights_;
};

}  // namespace toothprep::testing
