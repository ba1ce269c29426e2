// Sweeps and items that need one another: what becomes of the manifest, and how it runs.
#include <gmock/gmock.h>

#include <filesystem>
#include <functional>
#include <map>
#include <set>

#include "scratch_folder.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/batch/manifest.h"
#include "toothprep/tools/batch/run_batch.h"
#include "toothprep/tools/batch/summary.h"

namespace toothprep {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

// add --a FILE... [--b NUMBER]: the sum of the numbers in the files and b to sum.txt and as JSON.
constexpr const char* kAdd = R"sh(#!/bin/sh
[ "$1" = add ] || exit 2
shift
sum=0
while [ $# -gt 0 ]; do
  case $1 in
    --b) sum=$((sum + $2)); shift 2;;
    --a) shift;;
    *) [ "$(cat "$1")" != bad ] || { echo "toothprep: $1: is bad" >&2; exit 1; }
       sum=$((sum + $(cat "$1"))); shift;;
  esac
done
echo ran >> "$RAN"
echo $sum > sum.txt
echo $sum > big.vdb
printf '{"sum": %d}' $sum
)sh";

class SweepOfSums : public ScratchFolder {
 protected:
  void SetUp() override {
    ScratchFolder::SetUp();
    namespace fs = std::filesystem;
    fs::permissions(put("program", kAdd), fs::perms::owner_all);
    setenv("RAN", path("ran.txt").c_str(), 1);
    BatchCommand add;
    add.name = "add";
    add.inputs = {"a"};
    add.result = "result.json";
    add.result_on_stdout = true;
    add.made = {"sum.txt", "big.vdb"};
    commands_ = {add};
    options_.folder = path("out");
    options_.program = path("program");
    options_.version = "1";
    put("one.txt", "1");
  }
  BatchManifest read(const std::string& text) const {
    return read_manifest(put("manifest.toml", text), commands_);
  }
  BatchResult run(const std::string& text) const { return run_batch(read(text), options_); }
  void refused(const std::string& text, const std::string& says) const {
    try {
      read(text);
      ADD_FAILURE() << "not refused: " << text;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(says)) << text;
    }
  }
  int times_run() const {
    int lines = 0;
    if (exists("ran.txt"))
      for (const char c : get("ran.txt")) lines += c == '\n';
    return lines;
  }
  // Step and sum of all rows.
  static std::multiset<std::pair<std::string, std::string>> sums(const BatchResult& result) {
    std::multiset<std::pair<std::string, std::string>> found;
    for (const ItemRow& row : result.rows) found.insert({row.step, row.figure("sum")});
    return found;
  }

  std::vector<BatchCommand> commands_;
  BatchOptions options_;
};

// first depends on x only, second on x and y, through what it reads.
const std::string kChain = R"(
[sweep]
[sweep.over]
x = [10, 20]
y = [1, 2, 3]
[[sweep.step]]
name = "second"
command = "add"
arguments = { a = "{first/sum.txt}", b = "{y}" }
[[sweep.step]]
name = "first"
command = "add"
arguments = { a = "one.txt", b = "{x}" }
)";

TEST_F(SweepOfSums, EachItemRunsOnceHoweverManyPointsNeedIt) {
  const BatchManifest m = read(kChain);
  EXPECT_EQ(m.points, 6u);
  ASSERT_EQ(m.items.size(), 8u) << "2 of first, 6 of second";
  options_.at_once = 3;
  const BatchResult result = run_batch(m, options_);
  EXPECT_EQ(sums(result), (std::multiset<std::pair<std::string, std::string>>{{"first", "11"},
                                                                              {"first", "21"},
                                                                              {"second", "12"},
                                                                              {"second", "13"},
                                                                              {"second", "14"},
                                                                              {"second", "22"},
                                                                              {"second", "23"},
                                                                              {"second", "24"}}));
  EXPECT_EQ(times_run(), 8);
  EXPECT_EQ(run(kChain).run, 0u);
  EXPECT_THAT(get("out/batch.csv"),
              HasSubstr("name,status,command,reason,step,sweep.x,sweep.y,sum\n"));
  EXPECT_FALSE(exists("out/" + m.items[0].name)) << "folders are sharded";
  EXPECT_TRUE(exists("out/" + m.items[0].folder + "/sum.txt"));
}

TEST_F(SweepOfSums, AChangedManifestKeepsWhatIsStillValid) {
  run(kChain);
  std::string more = kChain;
  more.replace(more.find("[1, 2, 3]"), 9, "[0, 3, 1, 2]");
  EXPECT_EQ(run(more).run, 2u);  // y = 0 for both x
  put("one.txt", "2");
  EXPECT_EQ(run(more).run, 10u) << "what reads an output that changed runs again";
}

TEST_F(SweepOfSums, ALostLedgerChangesNothing) {
  run(kChain);
  const std::string csv = get("out/batch.csv");
  std::filesystem::remove_all(path("out/.batch"));
  EXPECT_EQ(run(kChain).run, 0u);
  EXPECT_EQ(get("out/batch.csv"), csv);
  // A line that was cut off, and one that is no line.
  put("out/.batch/rows/local.rows",
      get("out/.batch/rows/local.rows").substr(0, 300) + "\nx\ty\tz\nrest");
  EXPECT_EQ(run(kChain).run, 0u);
  EXPECT_EQ(get("out/batch.csv"), csv);
}

TEST_F(SweepOfSums, WhatNeedsAFailedItemIsNotRunAndSaysWhy) {
  put("one.txt", "bad");
  const BatchResult result = run(kChain);
  EXPECT_EQ(result.failed, 8u);
  int because = 0;
  for (const ItemRow& row : result.rows)
    because += row.reason.find("needs 'first-") == 0 && row.reason.ends_with("which failed");
  EXPECT_EQ(because, 6);
  put("one.txt", "1");
  options_.selection.failed = true;
  const BatchResult again = run(kChain);
  EXPECT_EQ(again.failed, 0u);
  EXPECT_EQ(again.left.size(), 0u) << "what needed the failed items has to run with them";
}

TEST_F(SweepOfSums, OnlyThoseThatMatchAndWhatTheyNeedRun) {
  options_.selection.only = "first-*";
  EXPECT_EQ(run(kChain).run, 2u);
  EXPECT_EQ(run(kChain).left.size(), 6u);
  options_.selection.only = "third-*";
  EXPECT_THROW(run(kChain), InputError);
  options_.selection = {};
  options_.look = true;
  EXPECT_EQ(run(kChain).left.size(), 6u);
  EXPECT_EQ(times_run(), 2);
}

TEST_F(SweepOfSums, FilesThatAreNotKeptStayWhileTheyAreNeededAndAreMadeAnewLater) {
  std::string text = kChain;
  text.replace(text.find("sum.txt}"), 8, "big.vdb}");
  text = "[defaults]\n" + text;
  for (const std::string step : {"\"second\"", "\"first\""})
    text.replace(text.find("name = " + step), 7 + step.size(), "keep = \"score\"\nname = " + step);
  const BatchManifest m = read(text);
  EXPECT_EQ(run(text).failed, 0u);
  EXPECT_EQ(times_run(), 8);
  for (const BatchItem& item : m.items) {
    EXPECT_FALSE(exists("out/" + item.folder + "/big.vdb"));
    EXPECT_TRUE(exists("out/" + item.folder + "/result.json"));
  }
  EXPECT_EQ(run(text).run, 0u);
  // y = 4 needs big.vdb of both of first: they run again, and only they.
  text.replace(text.find("[1, 2, 3]"), 9, "[1, 2, 4]");
  EXPECT_EQ(run(text).failed, 0u);
  EXPECT_EQ(times_run(), 8 + 2 + 2);
}

TEST_F(SweepOfSums, TextsAreFilledIn) {
  put("template.txt", "{x}");
  const BatchResult result = run(R"(
[sweep]
design = "list"
repeat = 2
[sweep.over]
x = [5, 7]
[[sweep.step]]
name = "s"
command = "add"
fill = ["a"]
arguments = { a = "template.txt", b = "{repeat}" }
)");
  EXPECT_EQ(sums(result), (std::multiset<std::pair<std::string, std::string>>{
                              {"s", "6"}, {"s", "7"}, {"s", "8"}, {"s", "9"}}));
}

TEST_F(SweepOfSums, PlainItemsTakeOutputsByNameInAnyOrder) {
  const std::string items = R"(
[[item]]
name = "b"
command = "add"
arguments = { a = ["{a/sum.txt}", "one.txt"] }
[[item]]
name = "a"
command = "add"
arguments = { a = "one.txt", b = 5 }
)";
  const BatchResult result = run(items);
  EXPECT_EQ(result.rows[0].figure("sum"), "7");
  EXPECT_EQ(result.rows[1].figure("sum"), "6");
}

TEST_F(SweepOfSums, RefusesWithWordsThatHelp) {
  const std::string item = "[[item]]\ncommand = \"add\"\nname = ";
  refused(item + "\"a\"\nafter = \"b\"\n" + item + "\"b\"\nafter = [\"a\"]\n",
          "need one another: a, b");
  refused(item + "\"a\"\narguments = { a = \"{a/sum.txt}\" }\n", "need one another: a");
  refused(item + "\"a\"\nafter = \"c\"\n", "needs 'c', which is no item");
  refused(item + "\"a\"\n" + item + "\"b\"\narguments = { a = \"{a/other.txt}\" }\n",
          "'a' writes no 'other.txt', but sum.txt, big.vdb, result.json");
  const auto with = [&](const std::string& what, const std::string& by) {
    std::string text = kChain;
    return text.replace(text.find(what), what.size(), by);
  };
  refused(with("{y}", "{y}{z}"), "{z} is no factor");
  refused(with("{y}", "1"), "sweep.over.y: is used by no step");
  refused(with("one.txt", "{second/sum.txt}"), "steps need one another");
  refused(with("[sweep]", "[sweep]\ndesign = \"gird\""), "did you mean \"grid\"?");
  refused(with("[sweep]", "[sweep]\ndesign = \"lhs\""), "samples: is missing");
  refused(with("[sweep]", "[sweep]\nsamples = 3"), "is for lhs and sobol");
  refused(with("[sweep]", "[sweep]\nrepeat = 3"), "sweep.repeat: is used by no step");
  refused(with("[sweep]", "[sweep]\nwhere = [\"x + y\"]"), "is no comparison");
  refused(with("[sweep]", "[sweep]\nwhere = [\"q < 1\"]"), "names no factor");
  refused(with("[sweep]", "[sweep]\nwhere = [\"x > 100\"]"), "no point left");
  refused(with("[10, 20]", "{ from = 1, to = 2 }"), "steps: is missing");
  refused(with("[10, 20]", "[10, 10]"), "holds 10 twice");
  refused(with("[10, 20]", "{ files = \"*.nothing\" }"), "matches no file");
  refused(with("x =", "file ="), "no good name");
}

TEST(SweepSummary, HasQuantilesAndTheEffectOfEachFactor) {
  std::vector<ItemRow> rows;
  for (const int x : {1, 2})
    for (const int y : {1, 2, 3}) {
      ItemRow row{"n", "replay", "done", "", {{"force", std::to_string(10 * x)}, {"steps", "7"}}};
      row.step = "cut";
      row.swept = {{"x", std::to_string(x)}, {"y", std::to_string(y)}};
      rows.push_back(row);
    }
  const std::string csv = summary_csv(rows);
  // All of the variance is x's: its levels have 10 and 20, those of y 15 each.
  EXPECT_THAT(csv, HasSubstr("cut,force,,all,6,15,"));
  EXPECT_THAT(csv, HasSubstr("cut,force,x,1,3,10,0,10,10,10,10,10,10,10,1,10\n"));
  EXPECT_THAT(csv, HasSubstr("cut,force,x,2,3,20,0,20,20,20,20,20,20,20,1,10\n"));
  EXPECT_THAT(csv, HasSubstr("cut,force,y,3,2,15,"));
  EXPECT_THAT(csv, AllOf(HasSubstr("cut,steps,,all,6,7,0,7"), Not(HasSubstr("cut,steps,x"))));
}

}  // namespace
}  // namespace toothprep
