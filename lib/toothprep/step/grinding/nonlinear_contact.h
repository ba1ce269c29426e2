// The elements in contact and their force where the grinding law isn't linear (grinding_law.h):
// element by element, since each has a chip thickness of its own.
#pragma once

#include <vector>

#include "toothprep/step/core/parameters.h"
#include "toothprep/step/grinding/contact_element.h"
#include "toothprep/step/grinding/grinding_law.h"

namespace toothprep {

class NonlinearContact {
 public:
  // Room for `capacity` elements in each tissue.
  NonlinearContact(std::size_t capacity, const PerTissue<GrindingProperties>& tissue);

  void clear() noexcept;
  // Adds an element of which `share` (0 .. 1) lies in the tissue of that index. Never beyond the
  // capacity.
  void add(const ContactElement& element, int tissue, float share) noexcept;
  int size() const noexcept;

  // The response at v (mm/s) and omega (rad/s), B, at the rotation rate N (rev/s): exact at v, and
  // linear around it. Either way (B v + f0) / N is the law's force at v.
  GrindingResponse response(const Vec3& v, const Vec3& omega, double rotation_rate,
                            LinearForm how) const noexcept;
  // The force at v, omega and N by other laws, one of each tissue, whatever the set's own: as of
  // TissueBasis where they have u = alpha = 1, or u = 0 and p = mu = 1 (what rubs).
  PerTissue<TissueBasis> basis(const std::vector<GrindingLaw>& law, const Vec3& v,
                               const Vec3& omega, double rotation_rate) const noexcept;
  GrindingRates rates(const Vec3& v, const Vec3& omega, double rotation_rate) const noexcept;
  PerTissue<double> advancing_area(const Vec3& v, const Vec3& omega) const noexcept;  // mm²

 private:
  struct Motion;
  struct Entries {  // of one tissue, one array each
    int count = 0;
    std::vector<float> nx, ny, nz, mx, my, mz, tx, ty, weight, arm, area;
  };
  struct Block;
  void gather(const Entries& entries, const GrindingLaw& law, const Motion& motion, int first,
              Block& block) const noexcept;
  GrindingResponse response_of(const Entries& entries, const Block& block,
                               LinearForm how) const noexcept;

  PerTissue<Entries> entries_;
  std::vector<GrindingLaw> law_;  // of each tissue
};

}  // namespace toothprep
