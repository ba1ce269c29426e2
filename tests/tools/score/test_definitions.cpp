#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>

#include "toothprep/tools/score/definitions.h"

namespace toothprep {
namespace {

TEST(Definitions, EveryKeyIsThereOnceWithNameUnitAndMeaning) {
  std::set<std::string> seen;
  for (const std::string& key : known_quantity_keys()) {
    EXPECT_TRUE(seen.insert(key).second) << key;
    const QuantityDefinition* d = find_definition(key);
    ASSERT_NE(d, nullptr) << key;
    EXPECT_FALSE(d->unit.empty()) << key;
    EXPECT_FALSE(d->name.empty()) << key;
    EXPECT_FALSE(d->definition.empty()) << key;
    EXPECT_EQ(d->definition.back(), '.') << key;
  }
}

TEST(Definitions, NoKeyIsAGroupAndAQuantityAtOnce) {
  const std::vector<std::string> keys = known_quantity_keys();
  for (const std::string& a : keys)
    for (const std::string& b : keys) EXPECT_NE(b.rfind(a + ".", 0), 0u) << a << " and " << b;
}

// Keys end with their unit, as the key of a table of figures must; a share, a count and a yes/no
// have none.
TEST(Definitions, KeysCarryTheirUnit) {
  const std::vector<std::pair<std::string, std::string>> endings = {
      {"mm", "mm"}, {"mm^2", "mm2"}, {"mm^3", "mm3"}, {"deg", "deg"},   {"s", "s"},
      {"N", "n"},   {"W", "w"},      {"J", "j"},      {"mm/s", "mm_s"}, {"mm^3/s", "mm3_s"},
      {"1", ""},    {"count", ""},   {"yes/no", ""}};
  for (const QuantityDefinition& row : quantity_definitions()) {
    bool known = false;
    for (const auto& [unit, ending] : endings) {
      if (unit != row.unit) continue;
      known = true;
      if (!ending.empty()) {
        EXPECT_TRUE(row.key.size() > ending.size() &&
                    row.key.substr(row.key.size() - ending.size() - 1) == "_" + ending)
            << row.key << " in " << row.unit;
      }
    }
    EXPECT_TRUE(known) << row.key << " has the unit " << row.unit;
  }
}

TEST(Definitions, NamesSayWhichMember) {
  EXPECT_EQ(quantity_name("floor_tilt_deg"), "floor tilt");
  EXPECT_EQ(quantity_name("wall_angles_deg.mesial"), "wall angle (mesial)");
  EXPECT_EQ(quantity_name("wall_angles_deg.proximal_buccal"), "wall angle (proximal buccal)");
  EXPECT_EQ(quantity_name("wall_angles_deg.u_plus"), "wall angle (u_plus)");
  EXPECT_EQ(quantity_name("something_else"), "something_else");
  EXPECT_EQ(find_definition("wall_angles_deg"), nullptr);  // a group is no quantity
}

TEST(Definitions, ValuesAreWrittenWithTheirUnit) {
  EXPECT_EQ(value_text(12.345, "deg"), "12.3°");
  EXPECT_EQ(value_text(1.5, "mm"), "1.50 mm");
  EXPECT_EQ(value_text(-0.001, "mm"), "0.00 mm");  // no minus before zero
  EXPECT_EQ(value_text(4.2, "mm^3"), "4.20 mm³");
  EXPECT_EQ(value_text(0.5, "mm^3/s"), "0.50 mm³/s");
  EXPECT_EQ(value_text(0.9876, "1"), "0.988");
  EXPECT_EQ(value_text(3, "count"), "3");
  EXPECT_EQ(value_text(1, "yes/no"), "yes");
  EXPECT_EQ(value_text(0.05, "mm", 3), "0.050 mm");
}

TEST(Definitions, AValueOfManyDigitsIsNotCut) {
  EXPECT_EQ(value_text(std::ldexp(1, 300), "mm").size(), 91 + 3 + 3U);  // 2^300 has 91 digits
}

// Read as a person would: each figure that a score can hold stands in exactly one row of the page,
// by itself or as a member of a group, with its unit.
TEST(Definitions, ThePageHasOneRowForEveryFigureWithItsUnit) {
  std::ifstream in(TOOTHPREP_SOURCE_DIR "/lib/toothprep/tools/score/DEFINITIONS.md");
  std::map<std::string, std::vector<std::string>> units;  // by key
  const std::regex row(R"(\| `([a-z0-9_.]+)(\{([^}]*)\})?` \| ([^|]*) \|.*)");
  for (std::string line; std::getline(in, line);) {
    std::smatch m;
    if (!std::regex_match(line, m, row)) continue;
    if (!m[2].matched) units[m[1]].push_back(m[4]);
    std::stringstream members(m[3]);
    for (std::string member; std::getline(members, member, ',');) {
      member.erase(0, member.find_first_not_of(' '));
      units[m[1].str() + member].push_back(m[4]);
    }
  }
  for (const std::string& key : known_quantity_keys()) {
    ASSERT_EQ(units[key].size(), 1u) << key;
    EXPECT_EQ(units[key][0], find_definition(key)->unit) << key;
  }
}

// With TOOTHPREP_WRITE_DEFINITIONS set the page is written instead of compared.
TEST(Definitions, ThePageIsThatOfTheTable) {
  const std::string path = TOOTHPREP_SOURCE_DIR "/lib/toothprep/tools/score/DEFINITIONS.md";
  if (std::getenv("TOOTHPREP_WRITE_DEFINITIONS")) std::ofstream(path) << definitions_page();
  std::ifstream in(path);
  std::stringstream page;
  page << in.rdbuf();
  EXPECT_EQ(page.str(), definitions_page())
      << "run: TOOTHPREP_WRITE_DEFINITIONS=1 build/tests/test_score --gtest_filter='Definitions.*'";
}

}  // namespace
}  // namespace toothprep
