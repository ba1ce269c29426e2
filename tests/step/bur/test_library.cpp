// --bur: the shorthand, the library, profile files, and what is said about mistakes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include "bur_cases.h"
#include "toothprep/step/bur/bur_shapes.h"
#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;
using testing::library_folder;
using ::testing::Not;
using testing::Random;

std::string refusal(const std::string& spec) {
  try {
    static_cast<void>(make_bur(spec, library_folder()));
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), Not(HasSubstr("\n"))) << "one line";
    return error.what();
  }
  return "";
}

TEST(Shorthand, LettersMeanWhatTheySay) {
  struct Measured {
    const char* spec;
    double diameter, length, tip, end;  // end: at the shank
  };
  for (const Measured& m : std::vector<Measured>{
           {"cylinder:D1.2xL3.0", 1.2, 3.0, 1.2, 1.2},
           {"cylinder:L3.0xD1.2", 1.2, 3.0, 1.2, 1.2},
           {"cylinder:d1.2xl3", 1.2, 3.0, 1.2, 1.2},
           {"cylinder:D1.2xL3.0xR0.2", 1.2, 3.0, 0.8, 1.2},
           {"cone:D1.2xL4.0xT0.6", 1.2, 4.0, 0.6, 1.2},
           {"cone:D1.2xL4.0xA3", 1.2, 4.0, 1.2 - 8.0 * std::tan(units::from_degree(3)), 1.2},
           {"cone:D1.2xL4.0xT0", 1.2, 4.0, 0.0, 1.2},
           {"inverted-cone:D1.0xL1.0xN0.6", 1.0, 1.0, 1.0, 0.6},
           {"inverted-cone:D1.0xL1.0xA10", 1.0, 1.0, 1.0,
            1.0 - 2.0 * std::tan(units::from_degree(10))},
           {"pear:D0.8xL1.8xN0.5xR0.3", 0.8, 1.8, 0.2, 0.5},
           {"flame:D1.2xL8.0xB5xN0.9", 1.2, 8.0, 0.0, 0.9},
           {"torpedo:D1.4xL10.0", 1.4, 10.0, 0.0, 1.4},
           {"round-cylinder:D1.2xL8.0", 1.2, 8.0, 0.0, 1.2},
           {"ball:D1.2", 1.2, 1.2, 0.0, 0.0}}) {
    const Bur bur = make_bur(m.spec, "");
    const ProfilePiece &first = bur.profile().front(), &last = bur.profile().back();
    EXPECT_NEAR(2 * bur.max_radius(), m.diameter, 1e-9) << m.spec;
    EXPECT_NEAR(bur.head_length(), m.length, 1e-9) << m.spec;
    EXPECT_NEAR(2 * (first.z1 == 0 ? first.r1 : 0), m.tip, 1e-9) << m.spec;
    EXPECT_NEAR(2 * (last.grinds ? 0 : last.r0), m.end, 1e-9) << m.spec;
  }
}

TEST(Shorthand, RoundedPartsJoinSmoothly) {
  for (const char* spec :
       {"taper:D1.8xL8.0xT1.0", "taper:D1.2xL5.0xA3", "round-cylinder:D1.2xL8.0",
        "pear:D0.8xL1.8xN0.5", "pear:D0.8xL1.8xA4xR0.3", "cylinder:D1.2xL3.0xR0.2",
        "cone:D1.6xL4.0xT0.8xR0.2", "flame:D1.2xL8.0xT0.2", "torpedo:D1.4xL10.0xB2.0xT0.3",
        "inverted-cone:D1.4xL1.2xN0.8xR0.1"}) {
    const Bur bur = make_bur(spec, "");
    for (std::size_t i = 0; i + 2 < bur.profile().size();
         ++i) {  // all joints but the closing disc's
      const ProfilePoint a = point_on(bur.profile()[i], 1), b = point_on(bur.profile()[i + 1], 0);
      EXPECT_NEAR(a.along_r * b.along_r + a.along_z * b.along_z, 1, 1e-9)
          << spec << ", joint " << i;
    }
  }
}

TEST(Shorthand, TheTaperHasTheAngleAndTheTipItWasAskedFor) {
  const Bur by_angle = make_bur("taper:D1.2xL5.0xA3", "");
  const ProfilePiece& flank = by_angle.profile()[1];
  EXPECT_NEAR(std::atan2(flank.r1 - flank.r0, flank.z1 - flank.z0), units::from_degree(3), 1e-12);
  const Bur by_tip = make_bur("taper:D1.8xL8.0xT1.0", "");
  EXPECT_NEAR(arc_span(by_tip.profile()[0]).radius, 0.5, 1e-12);
}

TEST(Shorthand, ARoundedCornerLeavesTheConesFlankInPlace) {
  const ProfilePiece sharp = make_bur("cone:D1.6xL4.0xT0.8", "").profile()[1];
  const ProfilePiece round = make_bur("cone:D1.6xL4.0xT0.8xR0.2", "").profile()[2];
  ASSERT_EQ(round.kind, ProfilePiece::Kind::kLine);
  EXPECT_NEAR((round.r1 - round.r0) / (round.z1 - round.z0),
              (sharp.r1 - sharp.r0) / (sharp.z1 - sharp.z0), 1e-12);
  EXPECT_NEAR(round.r1, sharp.r1, 1e-12);
}

TEST(Shorthand, NeckIsTheStatedOneOrTheDocumentedDefault) {
  EXPECT_DOUBLE_EQ(make_bur("cylinder:D1.2xL3.0xS0.8", "").shank_radius(), 0.4);
  EXPECT_DOUBLE_EQ(make_bur("cylinder:D1.2xL3.0", "").shank_radius(), 0.5 * 0.8 * 1.2);
  EXPECT_DOUBLE_EQ(make_bur("ball:D1.2", "").shank_radius(), 0.5 * 0.6);
  EXPECT_DOUBLE_EQ(make_bur("cylinder:D3xL3.0", "").shank_radius(), 0.8);  // 1.6 mm at most
  EXPECT_DOUBLE_EQ(make_bur("cylinder:D1.2xL3.0", "").shank_top(), 9.0);
  EXPECT_EQ(make_bur("cylinder:D1.2xL3.0xS0", "").shank_radius(), 0.0);
}

TEST(Shorthand, MistakesAreNamed) {
  const struct {
    const char *spec, *said;
  } cases[] = {
      {"cylinder:D1.2", "needs L (head length, mm)"},
      {"cylinder:", "needs D (largest head diameter, mm)"},
      {"cylinder", "needs D"},
      {"cylinder:L3.0", "needs D"},
      {"cone:D1.2xL4.0", "needs T (tip diameter, mm) or A (flank angle, degrees per side)"},
      {"cone:D1.2xL4.0xT0.6xA3", "needs only one of"},
      {"cube:D1", "unknown shape 'cube'; known are ball, cylinder"},
      {":D1", "unknown shape ''"},
      {"cylinder:DnanxL3", "must be a number"},
      {"cylinder:DinfxL3", "must be a number"},
      {"cylinder:D1e999xL3", "must be a number"},
      {"cylinder:DxL3", "must be a number"},
      {"cylinder:D1,2xL3", "must be a number"},
      {"cylinder:D-1.2xL3", "within 0.05 .. 10"},
      {"cylinder:D0xL3", "within 0.05 .. 10"},
      {"cylinder:D12xL3", "within 0.05 .. 10"},
      {"cylinder:D0.0012xL0.003", "within 0.05 .. 10"},
      {"cylinder:D1.2xL60", "within 0.05 .. 50"},
      {"cylinder:D1.2xL3xQ1", "has no parameter 'Q'"},
      {"ball:D1.2xL3", "ball has no parameter 'L'"},
      {"cylinder:D1.2xL3xD1.2", "given twice"},
      {"cylinder:D1.2xxL3", "an x with nothing"},
      {"cylinder:D1.2xL3x", "an x with nothing"},
      {"cylinder:D1.2xL3xR0.7", "must not exceed D/2"},
      {"cone:D1.2xL4xT1.4", "use inverted-cone"},
      {"inverted-cone:D1xL1xN1.2", "use cone or taper"},
      {"round-cylinder:D1.2xL0.5", "at least D/2"},
      {"taper:D1.2xL4xT1.2", "use round-cylinder"},
      {"taper:D1.2xL4xA9", "leave no room"},
      {"flame:D1.2xL8xB9", "must be smaller than L"},
      {"torpedo:D1.2xL8xB0.3", "must be at least D/2"},
      {"", "is empty"},
  };
  for (const auto& c : cases) EXPECT_THAT(refusal(c.spec), HasSubstr(c.said)) << c.spec;
}

TEST(Shorthand, AnyNumbersGiveABurOfThoseSizesOrAnError) {
  Random random(5);
  int built = 0;
  for (int k = 0; k < 4000; ++k) {
    const auto names = shape_names();
    std::string spec = names[static_cast<std::size_t>(random.within(0, 9))] + ":";
    const double diameter = std::round(random.within(0.1, 3) * 100) / 100;
    const double length = std::round(random.within(0.1, 12) * 100) / 100;
    spec += "D" + std::to_string(diameter);
    if (spec.rfind("ball", 0) != 0) spec += "xL" + std::to_string(length);
    for (const char* letter : {"T", "A", "R", "N", "B"})
      if (random.within(0, 1) < 0.3)
        spec += "x" + std::string(letter) + std::to_string(random.within(0, 3));
    try {
      const Bur bur = make_bur(spec, "");
      ++built;
      EXPECT_NEAR(2 * bur.max_radius(), diameter, 1e-6) << spec;
      const bool ball = spec.rfind("ball", 0) == 0;
      EXPECT_NEAR(bur.head_length(), ball ? diameter : length, 1e-6) << spec;
      EXPECT_GT(bur.head_volume(), 0) << spec;
      EXPECT_LT(bur.distance(0, 0.5 * bur.head_length()), 0) << spec;
    } catch (const InputError&) {
    }
  }
  EXPECT_GT(built, 400);
}

TEST(Shorthand, GarbageIsAnErrorAndNothingElse) {
  Random random(6);
  const std::string alphabet = "DLTARNBSx0123456789.:-e+/ \t\xff";
  for (int k = 0; k < 3000; ++k) {
    std::string spec = k % 2 ? "cylinder:" : "";
    for (int n = static_cast<int>(random.within(0, 12)); n > 0; --n)
      spec += alphabet[static_cast<std::size_t>(random.within(0, double(alphabet.size())))];
    try {
      static_cast<void>(make_bur(spec, "no-such-folder"));
    } catch (const Error&) {
    }
  }
  EXPECT_THROW(static_cast<void>(make_bur(std::string(1000000, 'x'), library_folder())), Error);
}

TEST(Library, EveryEntryBuildsUnderItsOwnNameAndStatesItsSources) {
  const auto entries = list_library(library_folder());
  ASSERT_GE(entries.size(), 20u);
  std::set<std::string> names;
  for (const LibraryEntry& entry : entries) {
    EXPECT_TRUE(names.insert(entry.name).second) << entry.name;
    EXPECT_EQ(make_bur(entry.name, library_folder()).name(), entry.name);
    if (!entry.also.empty()) {
      EXPECT_TRUE(names.insert(entry.also).second) << entry.also;
      EXPECT_EQ(make_bur(entry.also, library_folder()).name(), entry.name);
    }
    // A source for each parameter of the shape.
    for (const char letter : std::string("DLTARNB")) {
      if (entry.shape.find(letter, entry.shape.find(':')) == std::string::npos) continue;
      EXPECT_THAT(entry.source, HasSubstr(std::string(1, letter) + ": ")) << entry.name;
    }
    EXPECT_FALSE(entry.description.empty());
  }
}

TEST(Library, CodesStateTheLargestDiameterInTenthsOfAMillimetre) {
  int codes = 0;
  for (const LibraryEntry& entry : list_library(library_folder())) {
    for (const std::string& name : {entry.name, entry.also}) {
      if (name.size() != 7 || name[3] != '-' || !std::isdigit(static_cast<unsigned char>(name[4])))
        continue;
      ++codes;
      EXPECT_NEAR(2 * make_bur(name, library_folder()).max_radius(),
                  std::stoi(name.substr(4)) / 10.0, 1e-9)
          << name;
    }
  }
  EXPECT_GE(codes, 12);
}

TEST(Library, NamesGoByAnyCaseAndMistypedOnesFindTheNearest) {
  EXPECT_EQ(make_bur("170l", library_folder()).name(), "170L");
  EXPECT_EQ(make_bur("Paper-Ball", library_folder()).name(), "paper-ball");
  EXPECT_THAT(refusal("837-12"), HasSubstr("the nearest are 837-012"));
  EXPECT_THAT(refusal("paper-cilinder"), HasSubstr("paper-cylinder"));
}

TEST(Library, AMissingFolderIsNamed) {
  try {
    static_cast<void>(make_bur("330", "no/such/folder"));
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("no/such/folder/library.toml: does not exist"));
  }
}

class ProfileFile : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(::testing::TempDir()) /
              ("toothprep-bur-" +
               std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string write(const std::string& text) {
    const std::string path = (folder_ / "bur.toml").string();
    std::ofstream(path, std::ios::binary) << text;
    return path;
  }
  std::filesystem::path folder_;
};

TEST_F(ProfileFile, OfARoundedCylinderIsTheShorthandsBur) {
  const Bur read =
      make_bur(write("name = \"mine\"\ndescription = \"d\"\nsource = \"s\"\n"
                     "[[piece]]\nkind = \"line\"\nto_mm = [0.4, 0]\n"
                     "[[piece]]\nkind = \"arc\"\nto_mm = [0.6, 0.2]\nradius_mm = 0.2\n"
                     "[[piece]]\nkind = \"polyline\"\nr_mm = [0.6, 0.6]\nz_mm = [1.5, 3.0]\n"),
               "");
  const Bur shorthand = make_bur("cylinder:D1.2xL3.0xR0.2", "");
  EXPECT_EQ(read.name(), "mine");
  EXPECT_NEAR(read.head_volume(), shorthand.head_volume(), 1e-12);
  EXPECT_NEAR(read.grinding_area(), shorthand.grinding_area(), 1e-12);
  EXPECT_DOUBLE_EQ(read.shank_radius(), shorthand.shank_radius());
  Random random(7);
  for (int k = 0; k < 200; ++k) {
    const double r = random.within(0, 1), z = random.within(-0.5, 3.5);
    EXPECT_NEAR(read.distance(r, z), shorthand.distance(r, z), 1e-12);
  }
}

TEST_F(ProfileFile, GivesTheCentreInsteadOfTheRadiusAndConcaveArcs) {
  const Bur read =
      make_bur(write("[[piece]]\nkind = \"line\"\nto_mm = [0.3, 0]\n"
                     "[[piece]]\nkind = \"line\"\nto_mm = [0.3, 1]\n"
                     "[[piece]]\nkind = \"arc\"\nto_mm = [0.7, 1.4]\nradius_mm = 0.4\n"
                     "convex = false\n"
                     "[[piece]]\nkind = \"arc\"\nto_mm = [0.7, 2.4]\ncenter_mm = [0.7, 1.9]\n"
                     "[shank]\ndiameter_mm = 0.5\ntop_mm = 7\n"),
               "");
  EXPECT_NEAR(read.profile()[2].centre_r, 0.7, 1e-12);  // in the corner, not at (0.3, 1.4)
  EXPECT_NEAR(read.profile()[2].centre_z, 1.0, 1e-12);
  EXPECT_NEAR(read.max_radius(), 1.2, 1e-12);
  EXPECT_DOUBLE_EQ(read.shank_radius(), 0.25);
  EXPECT_DOUBLE_EQ(read.shank_top(), 7);
  EXPECT_EQ(read.name(), "bur");
}

TEST_F(ProfileFile, MistakesNameTheFileAndThePlace) {
  const std::string line = "[[piece]]\nkind = \"line\"\nto_mm = [0.6, 0]\n";
  const struct {
    std::string text, said;
  } cases[] = {
      {"", "needs either a shape or [[piece]]"},
      {"shape = \"ball:D1\"\n" + line, "needs either a shape or [[piece]]"},
      {"[[piece]\nkind", "line 1"},
      {line + "[[piece]]\nkind = \"line\"\nto_mm = [0.6, 3", "line 6"},
      {line + "colour = 3\n", "unknown key"},
      {line + "[[piece]]\nkind = \"line\"\nto = [0.6, 3.0]\n", "to_mm"},
      {line + "[[piece]]\nkind = \"spline\"\nto_mm = [0.6, 3.0]\n", "\"spline\" is not known"},
      {line + "[[piece]]\nto_mm = [0.6, 3.0]\n", "kind"},
      {line + "[[piece]]\nkind = \"line\"\nto_mm = [0.6, nan]\n", "must be finite"},
      {line + "[[piece]]\nkind = \"line\"\nto_mm = [0.6, 3.0, 1.0]\n", "two numbers [r, z]"},
      {line + "[[piece]]\nkind = \"line\"\nto_mm = [0.6, \"3\"]\n", "list of numbers"},
      {line + "[[piece]]\nkind = \"line\"\nto_mm = [600, 3000]\n", "above the limit of 10 mm"},
      {"[[piece]]\nkind = \"line\"\nto_mm = [0.0006, 0]\n[[piece]]\nkind = \"line\"\nto_mm = "
       "[0.0006, "
       "0.003]\n",
       "are the coordinates in mm?"},
      {line + "[[piece]]\nkind = \"arc\"\nto_mm = [0.6, 3]\nradius_mm = 1\n", "smaller than half"},
      {line + "[[piece]]\nkind = \"arc\"\nto_mm = [0.6, 3]\n", "either center_mm or radius_mm"},
      {line + "[[piece]]\nkind = \"arc\"\nto_mm = [0.6, 3]\ncenter_mm = [0, 0]\n",
       "not equally far"},
      {line + "[[piece]]\nkind = \"polyline\"\nr_mm = [0.6]\nz_mm = [1, 2]\n", "as many numbers"},
      {line + "[[piece]]\nkind = \"line\"\nto_mm = [0.6, 3]\n[shank]\ntop_mm = 2\n",
       "above the head"},
      {"name = 3\n" + line, "must be a text"},
      {line, "must end on the axis"},
      {"piece = 5\n", "must be tables"},
      {"shape = \"cube:D1\"\n", "unknown shape"},
  };
  for (const auto& c : cases) {
    const std::string path = write(c.text), said = refusal(path);
    EXPECT_THAT(said, HasSubstr(c.said)) << c.text;
    EXPECT_EQ(said.rfind(path, 0), 0u) << said;
  }
  EXPECT_THAT(refusal((folder_ / "absent.toml").string()), HasSubstr("does not exist"));
  EXPECT_THAT(refusal(folder_.string()), HasSubstr("is a folder"));
}

}  // namespace
}  // namespace toothprep
