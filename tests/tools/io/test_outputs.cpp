// Outputs: what is refused before anything runs, what appears, and what is left when it goes wrong.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <thread>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/folder_marker.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/io/part.h"
#include "toothprep/tools/io/rename.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep {
namespace {
namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::vector<std::string> kText = {".txt"};

std::string read(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

std::string error_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& e) {
    return e.what();
  }
  return {};
}

class OutputsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::canonical(::testing::TempDir()) /
              ("toothprep_outputs_" + std::to_string(getpid()) + "_" +
               ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string at(const std::string& name) const { return (folder_ / name).string(); }
  // All that is there, hidden files too.
  std::vector<std::string> entries(const std::string& below = {}) const {
    std::vector<std::string> names;
    for (const auto& entry : fs::recursive_directory_iterator(folder_ / below))
      names.push_back(entry.path().lexically_relative(folder_).string());
    std::sort(names.begin(), names.end());
    return names;
  }
  // The refusal of one file or folder.
  std::string refusal(const std::string& name, bool force, bool folder = false,
                      const std::vector<std::string>& inputs = {}) const {
    return error_of([&] {
      Outputs outputs(force);
      for (const std::string& input : inputs) outputs.reads({at(input)});
      folder ? outputs.folder(at(name)) : outputs.file(at(name), kText);
      outputs.begin();
    });
  }
  void make_folder(const std::string& name, const std::vector<std::string>& files) const {
    Outputs outputs(true);
    const std::string part = outputs.folder(at(name));
    outputs.begin();
    for (const std::string& file : files) {
      fs::create_directories((fs::path(part) / file).parent_path());
      write_file(part + "/" + file, file);
    }
    outputs.publish();
  }
  fs::path folder_;
};

TEST_F(OutputsTest, AppearWhenPublishedUnderTheirOwnNamesAlone) {
  Outputs outputs(false);
  const std::string a = outputs.file(at("a.txt"), kText), d = outputs.folder(at("d")),
                    none = outputs.optional_file("", kText);
  outputs.begin();
  EXPECT_EQ(none, "");
  EXPECT_EQ(fs::path(a).parent_path(), folder_);  // a rename, never a copy
  EXPECT_EQ(fs::path(a).extension(), ".txt");
  write_file(a, "new");
  write_file(d + "/inside", "1");
  EXPECT_FALSE(fs::exists(at("a.txt")) || fs::exists(at("d")));
  outputs.publish();
  EXPECT_EQ(read(at("a.txt")), "new");
  EXPECT_THAT(entries(), ElementsAre("a.txt", "d", "d/.toothprep-folder", "d/inside"));
}

TEST_F(OutputsTest, LeaveNothingWhenTheWorkFails) {
  error_of([&] {
    Outputs outputs(false);
    write_file(outputs.file(at("a.txt"), kText), "half");
    write_file(outputs.folder(at("d")) + "/inside", "half");
    outputs.begin();
    throw Error("the work failed");
  });
  EXPECT_THAT(entries(), ElementsAre());
}

TEST_F(OutputsTest, AnOutputThatNobodyWroteIsAnError) {
  EXPECT_THAT(error_of([&] {
                Outputs outputs(false);
                outputs.file(at("a.txt"), kText);
                outputs.begin();
                outputs.publish();
              }),
              HasSubstr("nothing was written"));
  EXPECT_THAT(entries(), ElementsAre());
}

TEST_F(OutputsTest, AnExistingOneIsReplacedOnlyWithForceAndOnlyAtTheEnd) {
  write_file(at("a.txt"), "old");
  EXPECT_THAT(refusal("a.txt", false), HasSubstr("a.txt: exists already; give --force"));
  Outputs outputs(true);
  const std::string a = outputs.file(at("a.txt"), kText);
  outputs.begin();
  write_file(a, "new");
  EXPECT_EQ(read(at("a.txt")), "old");
  outputs.publish();
  EXPECT_EQ(read(at("a.txt")), "new");
  EXPECT_THAT(entries(), ElementsAre("a.txt"));
}

TEST_F(OutputsTest, WhatAppearsDuringTheRunStaysAndNoneOfTheOutputsIsPublished) {
  Outputs outputs(false);
  const std::string a = outputs.file(at("a.txt"), kText), b = outputs.file(at("b.txt"), kText);
  outputs.begin();
  write_file(a, "a");
  write_file(b, "b");
  write_file(at("b.txt"), "somebody's");
  EXPECT_THAT(error_of([&] { outputs.publish(); }), HasSubstr("b.txt: appeared"));
  EXPECT_EQ(read(at("b.txt")), "somebody's");
  EXPECT_FALSE(fs::exists(at("a.txt")));
}

TEST_F(OutputsTest, IfOneCannotBePublishedTheOthersAreTakenBack) {
  write_file(at("a.txt"), "old");
  {
    Outputs outputs(true);
    const std::string a = outputs.file(at("a.txt"), kText), b = outputs.file(at("b.txt"), kText),
                      c = outputs.file(at("c.txt"), kText);
    outputs.begin();
    for (const std::string& part : {a, b, c}) write_file(part, "new");
    fs::create_directory(at("c.txt"));  // can't be replaced by a file
    EXPECT_THAT(error_of([&] { outputs.publish(); }), HasSubstr("c.txt: is a folder"));
  }
  EXPECT_EQ(read(at("a.txt")), "old");
  EXPECT_THAT(entries(), ElementsAre("a.txt", "c.txt"));
}

TEST_F(OutputsTest, NamesThatCannotBeWrittenAreRefused) {
  write_file(at("file"), "x");
  fs::create_directory(at("sub.txt"));
  ASSERT_EQ(mkfifo(at("fifo.txt").c_str(), 0600), 0);
  fs::create_symlink("nowhere", at("link.txt"));
  EXPECT_THAT(error_of([] { Outputs(true).file("", kText); }), HasSubstr("needs a file name"));
  EXPECT_THAT(refusal("none/a.txt", true), HasSubstr("none' does not exist; create it first"));
  EXPECT_THAT(refusal("file/a.txt", true), HasSubstr("does not exist"));
  EXPECT_THAT(refusal("sub.txt", true), HasSubstr("sub.txt: is a folder"));
  EXPECT_THAT(refusal("sub.txt/", true), HasSubstr("is a folder"));
  EXPECT_THAT(refusal("file", true, true), HasSubstr("file: is a file"));
  EXPECT_THAT(refusal("fifo.txt", true), HasSubstr("is no regular file"));
  EXPECT_THAT(refusal("link.txt", true), HasSubstr("is a link to nothing"));
  EXPECT_THAT(refusal(std::string(300, 'a') + ".txt", true), HasSubstr("File name too long"));
  for (const bool force : {false, true})
    EXPECT_THAT(error_of([&] { Outputs(force).file("/dev/null", kText); }),
                HasSubstr("/dev/null: is no regular file"));
  struct stat null {};
  ASSERT_EQ(stat("/dev/null", &null), 0);
  EXPECT_TRUE(S_ISCHR(null.st_mode));
}

TEST_F(OutputsTest, AnotherFormatsExtensionIsRefused) {
  const auto refused = [&](const std::string& name, const std::vector<std::string>& extensions) {
    return error_of([&] { Outputs(false).file(at(name), extensions); });
  };
  EXPECT_THAT(refused("a.vdb", {".h5"}),
              HasSubstr("another format; this output is written as .h5"));
  EXPECT_THAT(refused("a.nii", {".ply", ".stl", ".obj"}), HasSubstr(".ply, .stl or .obj"));
  EXPECT_THAT(refused("a.gz", {".nii", ".nii.gz"}), HasSubstr("another format"));
  EXPECT_THAT(refused("a", {".ply", ".stl"}), HasSubstr("does not say its format"));
  EXPECT_THAT(refused(".ply", {".ply", ".stl"}), HasSubstr("does not say its format"));
  EXPECT_EQ(refused("a.PLY", {".ply", ".stl"}), "");
  EXPECT_EQ(refused("a.v2", {".h5"}), "");
  EXPECT_EQ(refused("a", {".h5"}), "");
  EXPECT_TRUE(Outputs(false).file(at("a.nii.gz"), {".nii", ".nii.gz"}).ends_with(".nii.gz"));
}

TEST_F(OutputsTest, AnInputIsNeverAnOutputWhateverItsNames) {
  write_file(at("in.txt"), "mine");
  fs::create_directory(at("scan"));
  write_file(at("scan/slice.txt"), "mine");
  fs::create_hard_link(at("in.txt"), at("hard.txt"));
  fs::create_symlink("in.txt", at("soft.txt"));
  fs::create_directory_symlink("scan", at("other"));
  EXPECT_THAT(refusal("in.txt", true, false, {"in.txt"}), HasSubstr("is read as an input"));
  EXPECT_THAT(refusal("./scan/../in.txt", true, false, {"in.txt"}), HasSubstr("is read as an"));
  EXPECT_THAT(refusal("hard.txt", true, false, {"in.txt"}), HasSubstr("is read as an input"));
  EXPECT_THAT(refusal("soft.txt", true, false, {"in.txt"}), HasSubstr("is read as an input"));
  EXPECT_THAT(refusal("in.txt", true, false, {"soft.txt"}), HasSubstr("is read as an input"));
  EXPECT_THAT(refusal("scan/slice.txt", true, false, {"scan"}), HasSubstr("which is read"));
  EXPECT_THAT(refusal("other/slice.txt", true, false, {"scan"}), HasSubstr("which is read"));
  EXPECT_EQ(refusal("scan/new.txt", true, false, {"scan"}), "");
  EXPECT_EQ(refusal("new.txt", true, false, {"in.txt", "none"}), "");
  EXPECT_EQ(read(at("in.txt")), "mine");
}

TEST_F(OutputsTest, AFolderThatIsOrHoldsAnInputIsNeverReplaced) {
  make_folder("ours", {"slice.txt"});
  EXPECT_EQ(refusal("ours", true, true), "");
  EXPECT_THAT(refusal("ours", true, true, {"ours"}), HasSubstr("is read as an input"));
  EXPECT_THAT(refusal("ours", true, true, {"ours/slice.txt"}), HasSubstr("holds '"));
}

TEST_F(OutputsTest, TwoOutputsAreNotTheSameNorOneInTheOther) {
  const auto refused = [&](const std::string& one, const std::string& two) {
    return error_of([&] {
      Outputs outputs(true);
      outputs.file(at(one), kText);
      outputs.file(at(two), kText);
      outputs.begin();
    });
  };
  fs::create_directory(at("sub"));
  EXPECT_THAT(refused("a.txt", "a.txt"), HasSubstr("is named for two outputs"));
  EXPECT_THAT(refused("a.txt", "sub/../a.txt"), HasSubstr("is named for two outputs"));
  EXPECT_EQ(refused("a.txt", "b.txt"), "");
  make_folder("ours", {"x"});
  EXPECT_THAT(error_of([&] {
                Outputs outputs(true);
                outputs.folder(at("ours"));
                outputs.file(at("ours/a.txt"), kText);
                outputs.begin();
              }),
              HasSubstr("is written as a whole"));
  EXPECT_THAT(error_of([&] {
                Outputs outputs(true);
                outputs.growing(at("a.txt"), kText);
                outputs.file(at("a.txt"), kText);
                outputs.begin();
              }),
              HasSubstr("is named for two outputs"));
}

TEST_F(OutputsTest, OnlyAFolderOfOursWithNothingElseInItIsReplaced) {
  fs::create_directory(at("photographs"));
  write_file(at("photographs/1.jpg"), "mine");
  EXPECT_THAT(refusal("photographs", true, true),
              HasSubstr("holds '1.jpg' and was not written by this program"));
  make_folder("d", {"a", "sub/b"});
  make_folder("d", {"c"});  // replaced whole
  EXPECT_THAT(entries("d"), ElementsAre("d/.toothprep-folder", "d/c"));
  write_file(at("d/notes"), "mine");
  EXPECT_THAT(refusal("d", true, true), HasSubstr("holds 'notes', which this program did not"));
  fs::remove(at("d/notes"));
  fs::create_directories(at("d/more"));
  EXPECT_THAT(refusal("d", true, true), HasSubstr("holds 'more', which this program did not"));
  fs::remove(at("d/more"));
  write_file(at("d/c"), "mine now");
  EXPECT_THAT(refusal("d", true, true), HasSubstr("holds 'c', which was changed"));
  fs::remove(at("d/c"));
  fs::create_symlink("/etc/passwd", at("d/c"));
  EXPECT_THAT(refusal("d", true, true), HasSubstr("holds 'c'"));
  fs::create_directory(at("empty"));
  EXPECT_EQ(refusal("empty", true, true), "");
  EXPECT_THAT(error_of([] { Outputs(true).folder("/"); }), HasSubstr("not written by this"));
}

TEST_F(OutputsTest, WhatComesIntoAFolderDuringTheRunStays) {
  make_folder("d", {"a"});
  {
    Outputs outputs(true);
    write_file(outputs.folder(at("d")) + "/b", "new");
    outputs.begin();
    write_file(at("d/notes"), "mine");
    EXPECT_THAT(error_of([&] { outputs.publish(); }), HasSubstr("notes"));
  }
  EXPECT_THAT(entries(), ElementsAre("d", "d/.toothprep-folder", "d/a", "d/notes"));
}

TEST_F(OutputsTest, TheMarkerIsAListForSha256sum) {
  make_folder("d", {"a", "sub/b"});
  EXPECT_EQ(std::system(("cd " + at("d") + " && sha256sum -c --quiet .toothprep-folder").c_str()),
            0);
}

TEST_F(OutputsTest, ErrorsNameThePlaceThatTheUserNamed) {
  Outputs outputs(false);
  const std::string d = outputs.folder(at("d"));
  EXPECT_EQ(with_shown_names(d + "/x.csv: cannot be written"),
            at("d") + "/x.csv: cannot be written");
}

// ---- Renaming, also where the file system has no calls for it

class Renames : public OutputsTest, public ::testing::WithParamInterface<RenameCalls> {};

TEST_P(Renames, ReplaceNothingUnlessTheyExchange) {
  write_file(at("a"), "a");
  write_file(at("b"), "b");
  EXPECT_EQ(rename_to_new(at("a"), at("b"), GetParam()), EEXIST);
  EXPECT_EQ(read(at("b")), "b");
  EXPECT_EQ(exchange(at("a"), at("b"), GetParam()), 0);
  EXPECT_EQ(read(at("a")) + read(at("b")), "ba");
  EXPECT_EQ(rename_to_new(at("a"), at("c"), GetParam()), 0);
  fs::create_directory(at("d"));
  write_file(at("d/x"), "x");
  fs::create_directory(at("e"));
  EXPECT_EQ(rename_to_new(at("d"), at("e"), GetParam()), EEXIST);
  EXPECT_EQ(exchange(at("d"), at("e"), GetParam()), 0);
  EXPECT_EQ(rename_to_new(at("d"), at("f"), GetParam()), 0);
  EXPECT_EQ(exchange(at("c"), at("none"), GetParam()), ENOENT);
  EXPECT_THAT(entries(), ElementsAre("b", "c", "e", "e/x", "f"));
}

INSTANTIATE_TEST_SUITE_P(Calls, Renames,
                         ::testing::Values(RenameCalls::kBest, RenameCalls::kPlain));

// ---- Signals and killed processes: in a child, which ends as a program would.

class Killed : public OutputsTest, public ::testing::WithParamInterface<int> {
 protected:
  // Runs `work` in a child until it has said so; sends it the signal. Gives the signal that ended
  // it.
  int end_of(int signal, const std::function<void(int ready)>& work) const {
    int ends[2];
    EXPECT_EQ(pipe(ends), 0);
    const pid_t child = fork();
    if (child == 0) {
      work(ends[1]);
      _exit(0);
    }
    char c = 0;
    EXPECT_EQ(::read(ends[0], &c, 1), 1);
    kill(child, signal);
    int status = 0;
    waitpid(child, &status, 0);
    close(ends[0]);
    close(ends[1]);
    return WIFSIGNALED(status) ? WTERMSIG(status) : 0;
  }
  std::function<void(int)> long_work() const {
    return [this](int ready) {
      Outputs outputs(false);
      write_file(outputs.file(at("a.txt"), kText), "half");
      const std::string d = outputs.folder(at("d"));
      outputs.begin();
      fs::create_directories(d + "/sub");
      for (int k = 0; k < 300; ++k) write_file(d + "/sub/" + std::to_string(k), "half");
      EXPECT_EQ(write(ready, "x", 1), 1);
      sleep(60);
    };
  }
};

TEST_P(Killed, LeavesNothingBehindAndDiesOfTheSignal) {
  EXPECT_EQ(end_of(GetParam(), long_work()), GetParam());
  EXPECT_THAT(entries(), ElementsAre());
}

// The thread that handles the signal isn't the one that writes.
TEST_P(Killed, LeavesNothingThoughAnotherThreadReopensItsFileMeanwhile) {
  for (int k = 0; k < 10; ++k) {
    const int signal = end_of(GetParam(), [this](int ready) {
      Outputs outputs(false);
      const std::string part = outputs.file(at("a.txt"), kText);
      outputs.begin();
      for (int thread = 0; thread < 2; ++thread)
        std::thread([part] {
          for (;;) close(open(part.c_str(), O_WRONLY | O_CREAT, 0666));
        }).detach();
      EXPECT_EQ(write(ready, "x", 1), 1);
      sleep(60);
    });
    EXPECT_EQ(signal, GetParam());
    EXPECT_THAT(entries(), ElementsAre());
  }
}

INSTANTIATE_TEST_SUITE_P(Signals, Killed, ::testing::Values(SIGINT, SIGTERM, SIGHUP, SIGQUIT));

using KilledOutright = Killed;

TEST_F(KilledOutright, LeavesPartsThatTheNextRunRemoves) {
  EXPECT_EQ(end_of(SIGKILL, long_work()), SIGKILL);
  EXPECT_GT(entries().size(), 300u);
  EXPECT_EQ(refusal("b.txt", false), "");
  EXPECT_THAT(entries(), ElementsAre());
}

TEST_F(KilledOutright, PartsOfProcessesThatRunOrOfOtherMachinesStay) {
  const Part own(folder_, ".txt", "own.txt", false);
  std::string foreign = fs::path(own.path()).filename().string();
  foreign[std::strlen(".toothprep-part-")] ^= 1;  // another host
  write_file(at(foreign), "another machine's");
  write_file(at(".toothprep-part-mine"), "no part at all");
  remove_stale_parts(folder_);
  EXPECT_EQ(entries().size(), 3u);
}

TEST_F(KilledOutright, ASignalDuringTheLastPassWaitsForItsEnd) {
  EXPECT_EQ(end_of(SIGTERM,
                   [this](int ready) {
                     Outputs outputs(false);
                     write_file(outputs.file(at("a.txt"), kText), "whole");
                     outputs.begin();
                     const SignalsWait wait;
                     EXPECT_EQ(write(ready, "x", 1), 1);
                     sleep(1);  // ended by the signal, which only asks
                     outputs.publish();
                   }),
            SIGTERM);
  EXPECT_THAT(entries(), ElementsAre("a.txt"));
}

// ---- A full disk

TEST_F(OutputsTest, AFullDiskIsAnErrorAtWhateverByteItIsFull) {
  signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  for (const rlim_t size : {0, 1, 4095, 4096, 99999}) {
    const rlimit limit{size, before.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
    const std::string text = error_of([&] {
      Outputs outputs(false);
      const std::string a = outputs.file(at("a.txt"), kText);
      outputs.begin();
      write_file(a, std::string(100000, 'x'));
      outputs.publish();
    });
    setrlimit(RLIMIT_FSIZE, &before);
    EXPECT_THAT(text,
                HasSubstr("cannot be written: the file would get larger than is allowed here"))
        << size;
  }
  EXPECT_THAT(entries(), ElementsAre());
}

}  // namespace
}  // namespace toothprep
