#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/tools/io/write_file.h"
#include "toothprep/tools/score/score_file.h"

namespace toothprep {
namespace {

using Json = nlohmann::ordered_json;

ScoreSheet sheet() {
  ScoreSheet s;
  s.toothprep_version = "1.2.3";
  s.inputs = {{"original", "a.vdb", "aa"}, {"prepared", "b.vdb", "bb"}};
  s.type = "class1";
  s.type_from = "given";
  s.axis = Vec3(0, 0, 1);
  s.axis_from = "found";
  s.voxel_mm = 0.1;
  s.quantities = {{"removed_mm3.enamel", 3.5, 0.1, "mm^3"}, {"removed_mm3.dentin", 1, NAN, "mm^3"},
                  {"depth_mm", 1.75, 0.05, "mm"},           {"floor_tilt_deg", NAN, NAN, "deg"},
                  {"pulp_exposed", 0, NAN, "yes/no"},       {"process.stalls", 2, NAN, "count"}};
  s.result = judge(parse_rubric("name='r'\ntype='class1'\nsource='s'\npass_points=60\n"
                                "[[criterion]]\nkey='depth_mm'\nunit='mm'\nideal=[1.5,inf]\n"
                                "weight=2\nsource='s'\n",
                                "r.toml"),
                   s.quantities);
  s.notes = {"a note"};
  return s;
}

TEST(ScoreFile, HoldsTheSheet) {
  const Json j = Json::parse(score_json(sheet()));
  EXPECT_EQ(j["schema"], "toothprep-score");
  EXPECT_EQ(j["toothprep_version"], "1.2.3");
  EXPECT_EQ(j["inputs"]["prepared"]["file"], "b.vdb");
  EXPECT_EQ(j["inputs"]["prepared"]["sha256"], "bb");
  EXPECT_EQ(j["options"]["type"], "class1");
  EXPECT_EQ(j["options"]["axis"], Json::array({0.0, 0.0, 1.0}));
  EXPECT_EQ(j["options"]["voxel_mm"], 0.1);
  EXPECT_EQ(j["removed_mm3"]["enamel"], 3.5);
  EXPECT_EQ(j["depth_mm"], 1.75);
  EXPECT_EQ(j["pulp_exposed"], false);
  EXPECT_TRUE(j["process"]["stalls"].is_number_integer());
  EXPECT_EQ(j["uncertainty"]["removed_mm3.enamel"], 0.1);
  EXPECT_EQ(j["uncertainty"].size(), 2u);
  EXPECT_EQ(j["criteria"].size(), 1u);
  EXPECT_EQ(j["criteria"][0]["points"], 2.0);
  EXPECT_EQ(j["criteria"][0]["verdict"], "ideal");
  EXPECT_TRUE(j["criteria"][0]["ideal"][1].is_null());  // open
  EXPECT_EQ(j["points_percent"], 100.0);
  EXPECT_EQ(j["passed"], true);
  EXPECT_EQ(j["notes"], Json::array({"a note"}));
}

TEST(ScoreFile, WhatIsNotFiniteIsAbsent) {
  const std::string text = score_json(sheet());
  EXPECT_EQ(text.find("floor_tilt_deg"), std::string::npos);
  EXPECT_EQ(text.find("nan"), std::string::npos);
  EXPECT_EQ(text.find("inf"), std::string::npos);
}

TEST(ScoreFile, SameSheetSameText) { EXPECT_EQ(score_json(sheet()), score_json(sheet())); }

TEST(ScoreFile, KeysComeInTheOrderGiven) {
  const std::string text = score_json(sheet());
  EXPECT_LT(text.find("removed_mm3"), text.find("\"depth_mm\""));
  EXPECT_LT(text.find("\"enamel\""), text.find("\"dentin\""));
}

TEST(ScoreFile, WithoutARubricThereIsNoVerdict) {
  ScoreSheet s = sheet();
  s.result.reset();
  const Json j = Json::parse(score_json(s));
  EXPECT_FALSE(j.contains("passed"));
  EXPECT_FALSE(j.contains("criteria"));
}

TEST(ScoreFile, TextThatIsNotUtf8StillMakesJson) {
  ScoreSheet s = sheet();
  s.inputs[0].file = "t\xff\"o\\th.vdb";
  EXPECT_NO_THROW(Json::parse(score_json(s)));
}

TEST(ScoreFile, KeysThatClashAreRefused) {
  for (const char* key : {"depth_mm", "depth_mm.least", "removed_mm3", "notes", "schema",
                          "uncertainty.depth_mm", "inputs.original"}) {
    ScoreSheet s = sheet();
    s.quantities.push_back({key, 1, NAN, "mm"});
    EXPECT_THROW(static_cast<void>(score_json(s)), Error) << key;
  }
}

class ScoredInputsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::create_directories(folder_);
    write_file(file("a.vdb"), "a");
    write_file(file("b.vdb"), "b");
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string file(const std::string& name) const { return (folder_ / name).string(); }
  void write(ScoreSheet s) const {
    for (ScoreInput& input : s.inputs) input.sha256 = sha256_of_file(file(input.file));
    write_score(s, file("score.json"));
  }

  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() / ("scored-inputs-" + std::to_string(getpid()));
};

TEST_F(ScoredInputsTest, AreFoundBesideTheScoreWithTheOptionsThatItWasMadeWith) {
  ScoreSheet s = sheet();
  s.registered = true;
  s.mm_per_unit = 0.001;
  write(s);
  const ScoredInputs inputs = read_scored_inputs(file("score.json"));
  EXPECT_EQ(inputs.original, file("a.vdb"));
  EXPECT_EQ(inputs.prepared, file("b.vdb"));
  EXPECT_EQ(inputs.target, "");
  EXPECT_TRUE(inputs.registered);
  EXPECT_EQ(inputs.mm_per_unit, 0.001);
  EXPECT_EQ(inputs.voxel_mm, 0.1);
  EXPECT_TRUE(inputs.changed.empty());
}

TEST_F(ScoredInputsTest, OnesThatWereChangedSinceAreNamed) {
  write(sheet());
  write_file(file("b.vdb"), "another");
  EXPECT_EQ(read_scored_inputs(file("score.json")).changed, std::vector{file("b.vdb")});
}

TEST_F(ScoredInputsTest, AFileThatIsGoneAndOtherJsonAreRefused) {
  write(sheet());
  std::filesystem::remove(file("b.vdb"));
  EXPECT_THROW(read_scored_inputs(file("score.json")), InputError);
  for (const char* text : {"", "[]", "{", "{\"schema\": 3}", "{\"schema\": \"toothprep-score\"}",
                           R"({"schema": "toothprep-score", "inputs": {"original": {"file": 3}}})",
                           R"({"schema": "toothprep-score", "inputs": 3})"}) {
    write_file(file("other.json"), text);
    EXPECT_THROW(read_scored_inputs(file("other.json")), InputError) << text;
  }
}

}  // namespace
}  // namespace toothprep
