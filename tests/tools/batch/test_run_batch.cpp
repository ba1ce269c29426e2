// Batches of a stand-in program, a shell script: what crashes, hangs or is interrupted, and what is
// done.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <thread>

#include "scratch_folder.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/batch/index_page.h"
#include "toothprep/tools/batch/run_batch.h"

namespace toothprep {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

// work INPUT MODE: writes out.bin and prints figures; or fails as MODE says. Each run leaves a
// mark.
constexpr const char* kProgram = R"(#!/bin/sh
[ "$1" = work ] || exit 2
input=$3 mode=$5
echo ran >> "$(dirname "$input")/ran.txt"
echo "working on something" >&2
case $mode in
  good) ;;
  fail) echo "toothprep: tooth.vdb: is broken; mend it" >&2; echo >&2; exit 1;;
  silent) exec 2>/dev/null; exit 3;;
  crash) kill -SEGV $$;;
  hang) sleep 60;;
  stubborn) trap '' TERM; while :; do sleep 0.05; done;;
  odd) echo "warning: the mesh is odd" >&2; echo "warning: and small" >&2;;
  empty) exit 0;;
  garbage) echo x > out.bin; echo "not json"; exit 0;;
  slow) sleep 0.2;;
esac
tr a-z A-Z < "$input" > out.bin || exit 1
size=$(wc -c < "$input")
printf '{"schema": "x", "bytes": %d, "half": %d.5, "time_us": %d, "ok": true, "group": {"b": 2, "a": 1},
 "criteria": [{"key": "depth_mm", "points": 3.25, "why": "a, \\"b\\""}], "list": [1, 2], "none": null}' $size $size $$
)";

class RunBatch : public ScratchFolder {
 protected:
  void SetUp() override {
    ScratchFolder::SetUp();
    namespace fs = std::filesystem;
    fs::permissions(put("program", kProgram), fs::perms::owner_all);
    for (const char* name : {"one", "two", "three"}) put(std::string(name) + ".txt", name);
    BatchCommand work;
    work.name = "work";
    work.inputs = {"a-input"};
    work.result = "result.json";
    work.result_on_stdout = true;
    work.made = {"out.bin"};
    work.unrepeatable = {"time_"};
    commands_ = {work};
    options_.folder = path("out");
    options_.program = path("program");
    options_.version = "1";
  }

  // Items by (name, mode), each with the input of that name or one.txt.
  BatchManifest manifest(const std::vector<std::pair<std::string, std::string>>& items) const {
    std::string text;
    for (const auto& [name, mode] : items)
      text += "[[item]]\ncommand = \"work\"\nname = \"" + name + "\"\narguments = { a_input = \"" +
              (exists(name + ".txt") ? name : "one") + ".txt\", mode = \"" + mode + "\" }\n";
    return read_manifest(put("manifest.toml", text), commands_);
  }
  BatchResult run(const std::vector<std::pair<std::string, std::string>>& items) const {
    return run_batch(manifest(items), options_);
  }
  static std::string error_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const Error& e) {
      return e.what();
    }
    return {};
  }
  int parts() const {  // hidden folders of items that aren't done
    int count = 0;
    for (const auto& entry : std::filesystem::directory_iterator(path("out")))
      count +=
          entry.is_directory() && entry.path().filename().string().starts_with(".toothprep-part-");
    return count;
  }
  int times_run() const {
    int lines = 0;
    if (exists("ran.txt"))
      for (const char c : get("ran.txt")) lines += c == '\n';
    return lines;
  }

  std::vector<BatchCommand> commands_;
  BatchOptions options_;
};

TEST_F(RunBatch, WritesAFolderAndARowForEachItem) {
  const BatchResult result = run({{"two", "good"}, {"one", "good"}});
  ASSERT_EQ(result.rows.size(), 2u);
  EXPECT_EQ(result.rows[0].name, "two");
  EXPECT_EQ(result.rows[0].status, "done");
  EXPECT_THAT(
      result.rows[0].figures,
      ElementsAre(std::pair("bytes", "3"), std::pair("half", "3.5"), std::pair("ok", "true"),
                  std::pair("group.b", "2"), std::pair("group.a", "1"),
                  std::pair("criteria.depth_mm.points", "3.25")));
  EXPECT_EQ(get("out/two/out.bin"), "TWO");
  EXPECT_EQ(get("out/two/log.txt"), "working on something\n");
  EXPECT_EQ(get("out/batch.csv"),
            "name,status,command,reason,bytes,half,ok,group.b,group.a,criteria.depth_mm.points\n"
            "two,done,work,,3,3.5,true,2,1,3.25\n"
            "one,done,work,,3,3.5,true,2,1,3.25\n");
  const auto json = nlohmann::json::parse(get("out/batch.json"));
  EXPECT_EQ(json["done"], 2);
  EXPECT_EQ(json["items"][1]["figures"]["half"], 3.5);
  EXPECT_EQ(parts(), 0);
}

TEST_F(RunBatch, AWarningOfAnItemStandsInItsRowAlsoWhenItWasDone) {
  for (int time = 0; time < 2; ++time) {
    const BatchResult result = run({{"one", "odd"}, {"two", "good"}});
    EXPECT_EQ(result.run, time == 0 ? 2 : 0);
    EXPECT_EQ(result.rows[0].status, "done with warning");
    EXPECT_EQ(result.rows[0].reason, "the mesh is odd (and 1 more)");
    EXPECT_EQ(result.rows[1].status, "done");
    EXPECT_FALSE(result.rows[0].failed());
    EXPECT_THAT(get("out/batch.csv"), HasSubstr("one,done with warning,work,the mesh is odd"));
    EXPECT_THAT(get("out/index.html"), HasSubstr("the mesh is odd (and 1 more)"));
  }
  const auto json = nlohmann::json::parse(get("out/batch.json"));
  EXPECT_EQ(json["done"], 2);
  EXPECT_EQ(json["done_with_warning"], 1);
}

TEST_F(RunBatch, GoesOnWhenAnItemFailsCrashesHangsOrWritesNothing) {
  options_.at_once = 4;
  options_.time_limit = 1;
  const BatchResult result = run({{"a", "fail"},
                                  {"b", "crash"},
                                  {"c", "hang"},
                                  {"d", "empty"},
                                  {"e", "garbage"},
                                  {"f", "silent"},
                                  {"one", "good"}});
  std::vector<std::string> reasons;
  for (const ItemRow& row : result.rows) reasons.push_back(row.reason);
  EXPECT_THAT(reasons,
              ElementsAre("tooth.vdb: is broken; mend it", HasSubstr("ended by signal 11"),
                          "took longer than 1 s", "wrote no out.bin",
                          "result.json: is no JSON object", HasSubstr("working on something"), ""));
  EXPECT_EQ(result.rows[6].status, "done");
  // Of a failed item nothing remains but why.
  EXPECT_FALSE(exists("out/e/out.bin"));
  EXPECT_TRUE(exists("out/a/log.txt"));
  EXPECT_THAT(get("out/batch.csv"), HasSubstr("a,failed,work,tooth.vdb: is broken; mend it,,,"));
  // Failed items run again, the good one doesn't.
  const int before = times_run();
  EXPECT_EQ(run({{"a", "fail"}, {"one", "good"}}).run, 1u);
  EXPECT_EQ(times_run(), before + 1);
}

TEST_F(RunBatch, KillsWhatDoesNotHeedTheTimeLimit) {
  options_.time_limit = 0.2;
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(run({{"a", "stubborn"}}).rows[0].reason, "took longer than 0.2 s");
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20));
}

TEST_F(RunBatch, DoesNotRepeatWhatIsDone) {
  EXPECT_EQ(run({{"one", "good"}, {"two", "good"}}).run, 2u);
  const std::string csv = get("out/batch.csv"), json = get("out/batch.json");
  EXPECT_EQ(run({{"one", "good"}, {"two", "good"}}).run, 0u);
  EXPECT_EQ(times_run(), 2);
  EXPECT_EQ(get("out/batch.csv"), csv);
  EXPECT_EQ(get("out/batch.json"), json);
  // A new item is the only one to run.
  EXPECT_EQ(run({{"one", "good"}, {"two", "good"}, {"three", "good"}}).run, 1u);
}

TEST_F(RunBatch, RepeatsWhatIsNoLongerTrue) {
  const std::vector<std::pair<std::string, std::string>> items = {{"one", "good"}, {"two", "good"}};
  run(items);
  put("one.txt", "changed input");
  EXPECT_EQ(run(items).run, 1u);
  EXPECT_EQ(get("out/one/out.bin"), "CHANGED INPUT");
  put("out/two/out.bin", "damaged output");
  EXPECT_EQ(run(items).run, 1u);
  EXPECT_EQ(get("out/two/out.bin"), "TWO");
  std::filesystem::remove(path("out/two/out.bin"));
  EXPECT_EQ(run(items).run, 1u);
  put("out/two/item.json",
      "{\"schema\": \"toothprep-batch-item\", \"status\": 3, \"outputs\": {\"out.bin\": 0, "
      "\"result.json\": 0}}");
  EXPECT_EQ(run(items).run, 1u);
  EXPECT_EQ(run({{"one", "slow"}, {"two", "good"}}).run, 1u);  // another command line
  options_.version = "2";
  EXPECT_EQ(run(items).run, 2u);
  options_.redo = true;
  EXPECT_EQ(run(items).run, 2u);
}

TEST_F(RunBatch, WritesTheSameBytesHoweverManyRunAtATime) {
  std::vector<std::pair<std::string, std::string>> items;
  for (int i = 0; i < 12; ++i)
    items.push_back({"item" + std::to_string(i), i % 4 == 1   ? "fail"
                                                 : i % 3 == 0 ? "slow"
                                                              : "good"});
  run(items);
  const std::string csv = get("out/batch.csv"), json = get("out/batch.json");
  for (const int at_once : {3, 12}) {
    options_.at_once = at_once;
    options_.folder = path("out" + std::to_string(at_once));
    run(items);
    EXPECT_EQ(get("out" + std::to_string(at_once) + "/batch.csv"), csv);
    EXPECT_EQ(get("out" + std::to_string(at_once) + "/batch.json"), json);
  }
}

TEST_F(RunBatch, StopsItsChildrenWhenInterruptedAndGoesOnLater) {
  options_.at_once = 2;
  options_.interrupted = [&] { return exists("out/one") && parts() > 0; };
  const BatchResult result = run({{"one", "good"}, {"a", "hang"}, {"two", "good"}, {"b", "hang"}});
  EXPECT_TRUE(result.interrupted);
  EXPECT_TRUE(exists("out/one/item.json"));
  EXPECT_FALSE(exists("out/a"));
  EXPECT_EQ(parts(), 0);
  EXPECT_FALSE(exists("out/batch.csv"));
  options_.interrupted = {};
  EXPECT_LE(run({{"one", "good"}, {"a", "good"}, {"two", "good"}}).run, 2u);
  EXPECT_TRUE(exists("out/batch.csv"));
}

TEST_F(RunBatch, ClearsAwayWhatAKilledBatchLeft) {
  const pid_t batch = fork();
  if (batch == 0) {
    run({{"a", "hang"}});
    _exit(0);
  }
  for (int k = 0; k < 1000 && !exists("ran.txt"); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  kill(batch, SIGKILL);
  waitpid(batch, nullptr, 0);
  EXPECT_GT(parts(), 0);
  EXPECT_EQ(run({{"one", "good"}}).rows[0].status, "done");
  EXPECT_EQ(get("out/one/out.bin"), "ONE");
  EXPECT_EQ(parts(), 0);
}

TEST_F(RunBatch, NeverReplacesAFolderThatNoBatchWrote) {
  put("out/one/precious.vdb", "a student's work");
  EXPECT_THROW(run({{"two", "good"}, {"one", "good"}}), Error);
  EXPECT_EQ(get("out/one/precious.vdb"), "a student's work");
  EXPECT_EQ(times_run(), 0);
  run({{"two", "good"}});
  put("out/two/notes.txt", "a teacher's");
  options_.redo = true;
  EXPECT_THAT(error_of([&] {
                run({{"two", "good"}});
              }),
              HasSubstr("out/two: holds 'notes.txt', which no batch wrote"));
  EXPECT_EQ(get("out/two/notes.txt"), "a teacher's");
  std::filesystem::remove(path("out/two/notes.txt"));
  put("out/batch.json", "a list of mine");
  EXPECT_THAT(error_of([&] {
                run({{"two", "good"}});
              }),
              HasSubstr("out/batch.csv: was not written by a batch"));
  EXPECT_EQ(get("out/batch.json"), "a list of mine");
  put("file", "x");
  options_.folder = path("file");
  EXPECT_THROW(run({{"one", "good"}}), Error);
  options_.folder = path("none/out");
  EXPECT_THROW(run({{"one", "good"}}), Error);
}

TEST_F(RunBatch, NeverReplacesAFolderThatHoldsWhatIsRead) {
  run({{"two", "good"}});
  const BatchManifest reads_itself =
      read_manifest(put("manifest.toml",
                        "[[item]]\ncommand = \"work\"\nname = \"two\"\narguments = { a_input = "
                        "\"out/two/out.bin\", mode = \"good\" }\n"),
                    commands_);
  EXPECT_THAT(error_of([&] { run_batch(reads_itself, options_); }),
              HasSubstr("out/two: holds 'out/two/out.bin', which is read"));
  EXPECT_EQ(get("out/two/out.bin"), "TWO");
}

TEST_F(RunBatch, TellsWhenTheProgramCannotBeStarted) {
  options_.program = path("no-such-program");
  const BatchResult result = run({{"one", "good"}});
  EXPECT_EQ(result.rows[0].status, "failed");
  EXPECT_THAT(result.rows[0].reason, HasSubstr("cannot be started"));
}

TEST_F(RunBatch, SaysAfterTheFirstItemThatTheOthersWillFillTheDisk) {
  std::vector<std::string> warnings;
  options_.warn = [&](const std::string& line) { warnings.push_back(line); };
  for (const char* name : {"one", "two", "three"})
    put(std::string(name) + ".txt", std::string(200'000, 'a'));
  options_.free_disk = [] { return 300'000.0; };  // an item writes 200 kB and three small files
  run({{"one", "good"}, {"two", "good"}});
  EXPECT_THAT(warnings, ElementsAre());
  options_.redo = true;
  run({{"one", "good"}, {"two", "good"}, {"three", "good"}});
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("2 more items like 'one'"));
  EXPECT_THAT(warnings[0], HasSubstr("0.3 MB are free"));
}

TEST_F(RunBatch, RefusesAFolderWhereAnotherBatchIsAtWork) {
  run({{"one", "good"}});
  const int other = open((path("out") + "/.batch.lock").c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_EQ(flock(other, LOCK_EX | LOCK_NB), 0);
  EXPECT_THAT(error_of([&] { run({{"one", "good"}}); }), HasSubstr("another batch is at work"));
  close(other);
  EXPECT_EQ(run({{"one", "good"}}).run, 0u);
}

// No decision by the clock: files of the future or the past are as good as others.
TEST_F(RunBatch, IsNotMisledByAClockThatIsWrong) {
  namespace fs = std::filesystem;
  run({{"one", "good"}, {"two", "good"}});
  const auto now = fs::file_time_type::clock::now();
  for (const auto& file : fs::recursive_directory_iterator(path("out") + "/one"))
    fs::last_write_time(file.path(), now + std::chrono::hours(100'000));
  fs::last_write_time(path("two.txt"), now - std::chrono::hours(100'000));
  EXPECT_EQ(run({{"one", "good"}, {"two", "good"}}).run, 0u);
  // An input that changed counts, however old its date.
  put("two.txt", "changed");
  fs::last_write_time(path("two.txt"), now - std::chrono::hours(100'000));
  EXPECT_EQ(run({{"one", "good"}, {"two", "good"}}).run, 1u);
}

// A file-size limit stands for a disk that is full: what could not be written failed, and runs
// when there is space again.
TEST_F(RunBatch, WhatAFullDiskStoppedRunsLater) {
  put("two.txt", std::string(100'000, 'a'));
  const pid_t limited = fork();
  if (limited == 0) {
    const rlimit limit{50'000, 50'000};
    setrlimit(RLIMIT_FSIZE, &limit);
    const BatchResult result = run({{"one", "good"}, {"two", "good"}});
    _exit(result.failed == 1 && result.rows.size() == 2 && result.rows[1].failed() ? 0 : 1);
  }
  int status = 0;
  waitpid(limited, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  EXPECT_FALSE(exists("out/two/out.bin"));
  const BatchResult after = run({{"one", "good"}, {"two", "good"}});
  EXPECT_EQ(after.run, 1u);
  EXPECT_EQ(after.failed, 0u);
}

TEST(ItemTable, QuotesAsCsvNeedsIt) {
  const std::vector<ItemRow> rows = {{"a,b", "score", "failed", "says \"no\"\nand more", {}},
                                     {"c", "score", "done", "", {{"y", "1"}}},
                                     {"d", "score", "done", "", {{"x", "2.5"}, {"y", "false"}}}};
  EXPECT_EQ(table_csv(rows),
            "name,status,command,reason,y,x\n"
            "\"a,b\",failed,score,\"says \"\"no\"\"\nand more\",,\n"
            "c,done,score,,1,\n"
            "d,done,score,,false,2.5\n");
}

TEST(ItemTable, PointsAndVerdictStandFirst) {
  const std::vector<ItemRow> rows = {
      {"a",
       "score",
       "done",
       "",
       {{"depth_mm", "2"}, {"points_percent", "61.5"}, {"passed", "false"}}},
      {"b", "score", "failed", "no file", {}}};
  EXPECT_EQ(table_csv(rows),
            "name,status,points_percent,passed,command,reason,depth_mm\n"
            "a,done,61.5,false,score,,2\n"
            "b,failed,,,score,no file,\n");
}

TEST(IndexPage, RanksByPointsAndEscapesWhatItShows) {
  const std::vector<ItemRow> rows = {
      {"low", "score", "done", "", {{"points_percent", "40"}, {"passed", "false"}}},
      {"<b>", "score", "failed", "says <script>", {}},
      {"top & 1",
       "score",
       "done with warning",
       "an odd mesh",
       {{"points_percent", "90"},
        {"passed", "true"},
        {"removed_mm3.enamel", "1.5"},
        {"removed_mm3.dentin", "2"},
        {"removed_mm3.total", "3.5"}}}};
  const std::string page = index_page(rows, "/nowhere", "9.9");
  const auto place = [&](const std::string& text) {
    EXPECT_THAT(page, HasSubstr(text));
    return page.find(text);
  };
  EXPECT_LT(place("<b>top &amp; 1</b>"), place("<b>low</b>"));
  EXPECT_LT(place("<b>low</b>"), place("<b>&lt;b&gt;</b>"));
  EXPECT_LT(place("90.0 %"), place("40.0 %"));
  place("1 of 2 passed; 2 done, 1 of them with a warning, 1 failed.");
  place("says &lt;script&gt;");
  place("an odd mesh");
  place(">3.50<");
  EXPECT_EQ(page.find("http"), std::string::npos) << "nothing comes from elsewhere";
  EXPECT_EQ(page.find("<script"), std::string::npos);
}

}  // namespace
}  // namespace toothprep
