#include <gtest/gtest.h>

#include <type_traits>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

TEST(InputErrors, CarryTheirPartsBesideTheSentence) {
  const InputError e("a.csv", "line 7", "is not a number", "write 1.5");
  EXPECT_STREQ(e.what(), "a.csv: line 7: is not a number; write 1.5");
  EXPECT_EQ(e.file(), "a.csv");
  EXPECT_EQ(e.place(), "line 7");
  EXPECT_EQ(e.condition(), "is not a number");
  EXPECT_EQ(e.remedy(), "write 1.5");
}

TEST(InputErrors, NeitherPlaceNorRemedyIsNeeded) {
  const InputError e("a.csv", "", "is empty");
  EXPECT_STREQ(e.what(), "a.csv: is empty");
  EXPECT_TRUE(e.place().empty());
  EXPECT_TRUE(e.remedy().empty());
}

TEST(InputErrors, AreCopiedWithoutThrowing) {
  EXPECT_TRUE(std::is_nothrow_copy_constructible_v<InputError>);
}

}  // namespace
}  // namespace toothprep
