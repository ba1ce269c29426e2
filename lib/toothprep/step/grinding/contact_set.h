// The elements in contact and their force: what both engines fill and the step reads.
//
// The law (the paper's Eqs 6-9 and 14). Each surface element that advances into tissue k takes the
// power u_k (v·n) ds. With the rim speed 2 pi N r this is a tangential force along n_t, and through
// alpha_k = F_t / F_n a normal force against n_n; with ds = r dphi dl
//
//   dF   = u_k / (2 pi N) · (v·n) · (n_t - n_n / alpha_k) dphi dl          N
//   dT_z = u_k / (2 pi N) · (v·n) · r dphi dl                             N·mm
//
// so that, summed over the advancing elements, F = B v + C omega and T = b·v + c·omega.
//
//   symbol      here                         unit        frame
//   v           feed velocity of the tip     mm/s        B
//   omega       rotation of the handle       rad/s       B    v(s) = v + omega x r(s)
//   n_n, n_t    SurfaceElements n, t         1           B
//   dphi dl     SurfaceElements weight       mm          (= ds / r)
//   u, alpha    GrindingProperties           N/mm², 1
//   N           rotation rate                rev/s       responses are for N = 1 rev/s: divide by N
//   B           GrindingResponse::B                 N·s/mm · rev/s
//
// Valid while the bur turns much faster than it feeds, so that the chip thickness doesn't depend on
// phi. Where the parameters ask for a law that isn't linear (grinding_law.h), nonlinear_contact.h
// holds the elements, and what is said here of sums doesn't apply.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/grinding/contact_element.h"
#include "toothprep/step/grinding/four_lanes.h"
#include "toothprep/step/grinding/nonlinear_contact.h"

namespace toothprep {

struct ContactEntries;

class ContactSet {
 public:
  // Room for `capacity` elements; the law of each tissue (validated by the caller). With
  // `trailing`, elements that move away from the tissue count like the others, with a negative
  // share: Eq. 8 taken literally.
  ContactSet(std::size_t capacity, const PerTissue<GrindingProperties>& tissue, bool trailing);

  using Element = ContactElement;

  // What several elements make together where all of them advance: sums over them of the weight
  // dphi dl times the products named. `feed` goes with v, `turn` with omega.
  struct Sums {
    // tx n, ty n (3 each), n n (xx, xy, xz, yy, yz, zz), r n (3); the last is ds, mm²
    std::array<float, 16> feed{};
    // tx m, ty m (3 each), n m (nx m, ny m, nz m), r m (3), with m = r x n_n; two are not used
    std::array<float, 20> turn{};
    void add(const Element& element) noexcept;
  };

  // Whether the law is the paper's.
  bool is_linear() const { return !nonlinear_; }
  // Where it isn't: the elements.
  const NonlinearContact& nonlinear() const { return *nonlinear_; }

  void clear() noexcept;
  // Adds an element of which `share` (0 .. 1) lies in a tissue (its index). Never beyond the capacity.
  void add(const Element& element, int tissue, float share) noexcept;
  // Four elements of one tissue at a time, those whose share is above `least_share`, in order; as by
  // add().
  struct FourElements {
    Float4 nx, ny, nz, mx, my, mz, tx, ty, weight, arm;  // as of ContactElement
  };
  void add_four(const FourElements& elements, int tissue, Float4 share, float least_share) noexcept;
  // What they make together by their shares; `turns`: with `turn`, else that is 0.
  static Sums sums_of(const FourElements& elements, Float4 share, bool turns) noexcept;
  // Elements that advance whatever the velocity that the set will be asked about, and lie in one
  // tissue: they cost next to nothing. Only of a linear set.
  void add_advancing(const Sums& sums, int elements, int tissue, bool turns) noexcept;
  // The same of several elements, one after another, where the handle doesn't turn: those of `sums`
  // at these `count` places.
  void add_advancing(const Sums* sums, const std::int32_t* places, int count, int tissue) noexcept;
  int size() const { return nonlinear_ ? nonlinear_->size() : advancing_ + count_; }

  // The response with the advancing set {v·n + omega·(r x n) > 0}; v in mm/s, omega in rad/s, B. A
  // linear one is the same at every rotation rate (rev/s) and for either linearisation.
  GrindingResponse response(const Vec3& v, const Vec3& omega, double rotation_rate,
                            LinearForm how = LinearForm::kSecant) const noexcept;
  // What the audit needs to know of a set that isn't linear.
  GrindingRates rates(const Vec3& v, const Vec3& omega, double rotation_rate) const noexcept {
    return nonlinear_ ? nonlinear_->rates(v, omega, rotation_rate) : GrindingRates();
  }
  AdvancingSet advancing_set(const Vec3& v, const Vec3& omega) const noexcept;  // of a linear one
  // Advancing contact area per tissue, mm².
  PerTissue<double> advancing_area(const Vec3& v, const Vec3& omega) const noexcept;
  // The force at v and omega split by tissue. Only of a linear set made with u = alpha = 1 for every
  // tissue, where an element's share of a tissue is that of its area, and its force splits along
  // n_n and n_t.
  PerTissue<TissueBasis> basis(const Vec3& v, const Vec3& omega) const noexcept;
  // Whether any element in contact advances.
  bool any_advances(const Vec3& v, const Vec3& omega) const noexcept;

 private:
  void put(const Element& element, float tangential, float normal) noexcept;
  ContactEntries entries(float least) const noexcept;
  void note_advancing(const Vec3& v, const Vec3& omega, float least) const noexcept;
  // B and b of the entries that advance, and which these are.
  const GrindingResponse& response_of_entries(const Vec3& v, const Vec3& omega) const noexcept;
  GrindingResponse linear_response(const Vec3& v, const Vec3& omega) const noexcept;
  void add_sums(const Vec3& omega, GrindingResponse& response) const noexcept;

  PerTissue<float> ct_{}, cn_{};  // u/(2 pi), u/(2 pi alpha)
  float least_;  // elements count above this advance: 0, or -infinity with `trailing`
  int count_ = 0, advancing_ = 0;
  PerTissue<Sums> sums_{};  // of the elements that advance anyway
  // One array each: normal, r x n, force per advance (coefficients of n_t and n_n summed), torque
  // per advance, area per tissue.
  std::vector<float> nx_, ny_, nz_, mx_, my_, mz_, qx_, qy_, qz_, torque_;
  std::vector<PerTissue<float>> area_;
  // From one velocity to the next the same entries advance, mostly, which is all that B, b and the areas
  // of these depend on: a bit for each, by fours, that was asked about last, and what was found of them. So
  // a set is not for several threads, not even to be read.
  mutable std::vector<std::uint8_t> advances_;
  struct Question {
    Vec3 v, omega;
    float least;
    int count;  // of entries
    bool operator==(const Question&) const = default;
  };
  mutable std::optional<Question> asked_;
  mutable std::optional<GrindingResponse> responded_;
  mutable std::optional<PerTissue<float>> measured_;
  std::optional<NonlinearContact> nonlinear_;  // then the rest is empty
};

}  // namespace toothprep
