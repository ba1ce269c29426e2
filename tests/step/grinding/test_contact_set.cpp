// The law on single elements, where every number can be written down: dF = u/(2 pi N) (v.n)
// (n_t - n_n/alpha) dphi dl, dT = u/(2 pi N) (v.n) r dphi dl.
#include <gtest/gtest.h>

#include <utility>

#include "toothprep/step/core/units.h"
#include "toothprep/step/grinding/contact_set.h"

namespace toothprep::testing {
namespace {

constexpr double kFloat = 1e-6;  // the set sums in single precision

PerTissue<GrindingProperties> tissues() {
  PerTissue<GrindingProperties> t{};
  for (int k = 0; k < kTissueCount; ++k) t[k] = {1.0, 1.0};
  t[0] = {300, 0.25};
  t[1] = {100, 0.5};
  return t;
}

// Faces +x at radius 0.5, so that n_t = +y.
ContactSet::Element facing_x() { return {1, 0, 0, 0, 0, 0, 0, 1, 0.2f, 0.5f, 0.1f}; }

TEST(ContactSet, OneElementFollowsTheLaw) {
  ContactSet set(4, tissues(), false);
  set.add(facing_x(), tissue_index(Tissue::kEnamel), 1);
  const Vec3 v(2, 0, 0);
  const GrindingResponse r = set.response(v, Vec3::Zero(), 1);
  const double per_advance = 300 / (2 * units::kPi) * 0.2;
  const Vec3 force = r.B * v;
  EXPECT_NEAR(force.x(), -per_advance * 2 / 0.25, 1e3 * kFloat);  // against n_n
  EXPECT_NEAR(force.y(), per_advance * 2, 1e3 * kFloat);          // along n_t
  EXPECT_EQ(force.z(), 0);
  EXPECT_NEAR(r.b.dot(v), per_advance * 2 * 0.5, 1e3 * kFloat);
  EXPECT_EQ(r.set.count, 1);
  EXPECT_NEAR(set.advancing_area(v, Vec3::Zero())[0], 0.1, kFloat);
}

TEST(ContactSet, AnElementThatRetreatsCountsForNothingUnlessTrailingIsAsked) {
  const Vec3 back(-2, 0, 0);
  ContactSet set(4, tissues(), false), literal(4, tissues(), true);
  set.add(facing_x(), tissue_index(Tissue::kEnamel), 1);
  literal.add(facing_x(), tissue_index(Tissue::kEnamel), 1);
  EXPECT_EQ(set.response(back, Vec3::Zero(), 1).B.norm(), 0);
  EXPECT_FALSE(set.any_advances(back, Vec3::Zero()));
  EXPECT_TRUE(set.any_advances(-back, Vec3::Zero()));
  EXPECT_EQ(set.advancing_area(back, Vec3::Zero())[0], 0);
  // Eq. 8 taken literally: the force is that of the advance with its sign.
  const Vec3 pulled = literal.response(back, Vec3::Zero(), 1).B * back;
  const Vec3 pushed = set.response(-back, Vec3::Zero(), 1).B * -back;
  EXPECT_LT((pulled + pushed).norm(), 1e3 * kFloat);
}

TEST(ContactSet, EachTissueOfAnElementCountsByItsPart) {
  ContactSet set(4, tissues(), false);
  set.add(facing_x(), 0, 0.25f);
  set.add(facing_x(), 1, 0.5f);  // a quarter is air
  const Vec3 v(1, 0, 0);
  const double weight = 0.2 / (2 * units::kPi);
  const Vec3 force = set.response(v, Vec3::Zero(), 1).B * v;
  EXPECT_NEAR(force.y(), weight * (0.25 * 300 + 0.5 * 100), 1e3 * kFloat);
  EXPECT_NEAR(force.x(), -weight * (0.25 * 300 / 0.25 + 0.5 * 100 / 0.5), 1e3 * kFloat);
  EXPECT_NEAR(set.advancing_area(v, Vec3::Zero())[1], 0.05, kFloat);
}

TEST(ContactSet, ATurnAddsTheVelocityOfTheElementsPlace) {
  // The element at r = (0.5, 0, 2): omega about y moves it by omega x r = (2 omega, 0, -omega/2).
  ContactSet set(4, tissues(), false);
  ContactSet::Element e = facing_x();
  const Vec3 m = Vec3(0.5, 0, 2).cross(Vec3(1, 0, 0));
  e.mx = static_cast<float>(m.x()), e.my = static_cast<float>(m.y()),
  e.mz = static_cast<float>(m.z());
  set.add(e, tissue_index(Tissue::kEnamel), 1);
  const Vec3 omega(0, 0.3, 0);
  const GrindingResponse turning = set.response(Vec3::Zero(), omega, 1);
  const GrindingResponse moving = set.response(Vec3(0.6, 0, 0), Vec3::Zero(), 1);
  EXPECT_LT((turning.f0 - moving.B * Vec3(0.6, 0, 0)).norm(), 1e3 * kFloat);
  EXPECT_NEAR(turning.t0, moving.b.dot(Vec3(0.6, 0, 0)), 1e3 * kFloat);
}

TEST(ContactSet, TheSetOfAVelocityTellsWhichElementsAdvance) {
  ContactSet set(8, tissues(), false);
  for (const double angle : {0.0, 1.0, 2.0, 3.0}) {
    ContactSet::Element e = facing_x();
    e.nx = static_cast<float>(std::cos(angle)), e.ny = static_cast<float>(std::sin(angle));
    set.add(e, tissue_index(Tissue::kDentin), 1);
  }
  EXPECT_EQ(set.advancing_set(Vec3(1, 0, 0), Vec3::Zero()).count, 2);   // cos > 0: 0 and 1
  EXPECT_EQ(set.advancing_set(Vec3(-1, 0, 0), Vec3::Zero()).count, 2);  // 2 and 3
  EXPECT_FALSE(set.advancing_set(Vec3(1, 0, 0), Vec3::Zero()) ==
               set.advancing_set(Vec3(-1, 0, 0), Vec3::Zero()));
  set.clear();
  EXPECT_EQ(set.size(), 0);
  EXPECT_EQ(set.response(Vec3(1, 0, 0), Vec3::Zero(), 1).B.norm(), 0);
}

TEST(ContactSet, AnswersAsANewOneDoesWhateverItWasAskedBefore) {
  const auto fill = [](ContactSet& set, double turned) {
    for (int k = 0; k < 7; ++k) {
      ContactSet::Element e = facing_x();
      const double angle = turned + 0.9 * k;
      e.nx = static_cast<float>(std::cos(angle)), e.ny = static_cast<float>(std::sin(angle));
      set.add(e, tissue_index(k % 2 ? Tissue::kDentin : Tissue::kEnamel), 0.5f);
    }
  };
  const Vec3 asked[] = {{1, 0, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0.2, 0}, {1, 0, 0}};
  for (const bool trailing : {false, true}) {
    ContactSet set(8, tissues(), trailing);
    for (const double turned : {0.0, 0.5}) {  // as many elements, other ones
      set.clear();
      fill(set, turned);
      for (const Vec3& v : asked) {
        ContactSet anew(8, tissues(), trailing);
        fill(anew, turned);
        EXPECT_TRUE(set.advancing_set(v, Vec3::Zero()) == anew.advancing_set(v, Vec3::Zero()));
        EXPECT_EQ(set.advancing_area(v, Vec3::Zero()), anew.advancing_area(v, Vec3::Zero()));
        EXPECT_EQ(set.response(v, Vec3::Zero(), 1).B, anew.response(v, Vec3::Zero(), 1).B);
      }
      const auto enamel = [&] {
        return set.advancing_area(asked[4], Vec3::Zero())[tissue_index(Tissue::kEnamel)];
      };
      const double before = enamel();
      set.add(facing_x(), tissue_index(Tissue::kEnamel), 1);
      EXPECT_NEAR(enamel() - before, facing_x().area, kFloat);
    }
  }
}

TEST(ContactSet, TheBasisAddsUpToTheForce) {
  PerTissue<GrindingProperties> ones{};
  for (auto& t : ones) t = {1, 1};
  ContactSet basis(4, ones, false), set(4, tissues(), false);
  for (ContactSet* s : {&basis, &set})
    for (const auto& [tissue, share] : {std::pair(0, 0.3f), {1, 0.7f}})
      s->add(facing_x(), tissue, share);
  const Vec3 v(1.5, 0.2, 0);
  const PerTissue<TissueBasis> b = basis.basis(v, Vec3::Zero());
  const auto t = tissues();
  Vec3 force = Vec3::Zero();
  double torque = 0;
  for (int k = 0; k < kTissueCount; ++k) {
    force += t[k].specific_energy * (b[k].tangential + b[k].normal / t[k].force_ratio);
    torque += t[k].specific_energy * b[k].torque;
  }
  const GrindingResponse r = set.response(v, Vec3::Zero(), 1);
  EXPECT_LT((force - r.B * v).norm(), 1e-5 * force.norm());
  EXPECT_NEAR(torque, r.b.dot(v), 1e-5 * torque);
}

}  // namespace
}  // namespace toothprep::testing
