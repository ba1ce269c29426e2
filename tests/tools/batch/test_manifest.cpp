// The manifest of a batch: what it may hold, and what is refused with words that help.
#include <gmock/gmock.h>

#include "scratch_folder.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/batch/manifest.h"

namespace toothprep {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

std::vector<BatchCommand> commands() {
  std::vector<BatchCommand> all = batch_commands();
  all[0].options = {"tooth", "trajectory",         "bur",    "params", "prepared",
                    "drive", "damping-n-s-per-mm", "strict", "json",   "output",
                    "force"};
  all[1].options = {"original", "prepared", "target", "rubric", "type", "report", "axis", "output"};
  return all;
}

class Manifest : public ScratchFolder {
 protected:
  BatchManifest read(const std::string& text) const {
    return read_manifest(put("class/manifest.toml", text), commands());
  }
  void refused(const std::string& text, const std::string& says) const {
    try {
      read(text);
      ADD_FAILURE() << "not refused: " << text;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(says)) << text;
      EXPECT_THAT(e.what(), HasSubstr("manifest.toml"));
    }
  }
};

TEST_F(Manifest, HoldsItemsWithDefaults) {
  put("class/tooth.vdb", "t");
  put("paths/a.toml", "a");
  const BatchManifest m = read(R"(
    [defaults]
    command = "replay"
    arguments = { tooth = "tooth.vdb", bur = "ball:D1.2", type = "crown" }
    [[item]]
    name = "first"
    arguments = { trajectory = "../paths/a.toml", damping_n_s_per_mm = 0.25, strict = true, prepared = true }
    [[item]]
    name = "second"
    command = "score"
    arguments = { original = "tooth.vdb", prepared = "tooth.vdb", axis = [0, 0.5, -1] }
  )");
  ASSERT_EQ(m.items.size(), 2u);
  EXPECT_EQ(m.items[0].name, "first");
  EXPECT_THAT(m.items[0].shown, ElementsAre("--bur", "ball:D1.2", "--damping-n-s-per-mm", "0.25",
                                            "--prepared", "prepared.vdb", "--strict", "--tooth",
                                            "tooth.vdb", "--trajectory", "../paths/a.toml"));
  EXPECT_EQ(m.items[0].arguments.back(), path("paths/a.toml"));
  EXPECT_THAT(m.items[0].made, ElementsAre("trace.h5", "replay.json", "prepared.vdb"));
  ASSERT_EQ(m.items[0].inputs.size(), 2u);
  EXPECT_EQ(m.items[1].command, 1u);
  // The default `type` goes where it is known; `bur` and `tooth` are none of a score's.
  EXPECT_THAT(m.items[1].shown, ElementsAre("--axis", "0,0.5,-1", "--original", "tooth.vdb",
                                            "--prepared", "tooth.vdb", "--type", "crown"));
}

TEST_F(Manifest, ScoresAFolderOfStudentsInFiveLines) {
  put("class/molar.vdb", "m");
  for (const char* who : {"berta", "anna", ".hidden"})
    put(std::string("class/students/") + who + "/prepared.vdb", who);
  put("class/students/carl/notes.txt", "handed in nothing");
  const BatchManifest m = read(R"(
    [folder]
    command = "score"
    pattern = "students/*/prepared.vdb"
    arguments = { original = "molar.vdb", type = "crown", report = true }
  )");
  ASSERT_EQ(m.items.size(), 2u);
  EXPECT_EQ(m.items[0].name, "anna");
  EXPECT_EQ(m.items[1].name, "berta");
  EXPECT_THAT(m.items[0].shown,
              ElementsAre("--original", "molar.vdb", "--prepared", "students/anna/prepared.vdb",
                          "--report", "report", "--type", "crown"));
}

TEST_F(Manifest, NamesItemsByWhatTheWildcardsStandFor) {
  for (const char* file : {"class/a/1/x.vdb", "class/b/1/x.vdb", "class/o.vdb"}) put(file, "x");
  const auto names = [&](const std::string& pattern) {
    std::vector<std::string> result;
    for (const BatchItem& item : read("[folder]\ncommand = \"score\"\npattern = \"" + pattern +
                                      "\"\n[folder.arguments]\noriginal = \"o.vdb\"")
                                     .items)
      result.push_back(item.name);
    return result;
  };
  EXPECT_THAT(names("*/*/x.vdb"), ElementsAre("a-1", "b-1"));
  EXPECT_THAT(names("a/1/*.vdb"), ElementsAre("x"));
  EXPECT_THAT(names(path("class/?/1/x.vdb")), ElementsAre("a", "b"));
}

TEST_F(Manifest, PutsNameAndFileIntoArguments) {
  put("class/o.vdb", "o");
  put("class/targets/anna.vdb", "t");
  put("class/in/anna.vdb", "a");
  const BatchManifest m = read(R"(
    [folder]
    command = "score"
    pattern = "in/*.vdb"
    arguments = { original = "o.vdb", prepared = "{file}", target = "targets/{name}.vdb" }
  )");
  EXPECT_THAT(m.items[0].shown, ElementsAre("--original", "o.vdb", "--prepared", "in/anna.vdb",
                                            "--target", "targets/anna.vdb"));
}

TEST_F(Manifest, RefusesWithWordsThatHelp) {
  put("class/t.vdb", "t");
  const std::string item = "[[item]]\ncommand = \"score\"\nname = \"a\"\n";
  refused("", "names no item");
  refused("[[item", "line 1");
  refused("[itm]\n", "did you mean 'item'?");
  refused(item + "argument = {}\n", "did you mean 'arguments'?");
  refused(item + "arguments = { orginal = \"t.vdb\" }\n", "did you mean 'original'?");
  refused("[defaults]\narguments = { orginal = \"t.vdb\" }\n" + item, "did you mean 'original'?");
  refused("[[item]]\nname = \"a\"\ncommand = \"scor\"\n", "did you mean \"score\"?");
  refused("[[item]]\nname = \"a\"\n", "command: is missing");
  refused("[[item]]\ncommand = \"score\"\n", "name: is missing");
  refused(item + "arguments = { original = \"none.vdb\" }\n", "there is no file");
  refused(item + "arguments = { original = \"\" }\n", "there is no file");
  refused(item + "arguments = { original = true }\n", "must name a file");
  refused(item + "arguments = { output = \"x\" }\n", "set by the batch itself");
  refused(item + "arguments = { report = \"x\" }\n", "report = true");
  refused(item + "arguments = { type = { a = 1 } }\n", "must be a text");
  refused(item + "arguments = 3\n", "must be a table");
  refused(item + item, "is used twice");
  for (const char* name :
       {"", "..", "a/b", "a..b", ".a", "-a", "a\\\\b", "a.part", "batch.csv", "a\\n"})
    refused("[[item]]\ncommand = \"score\"\nname = \"" + std::string(name) + "\"\n", "the name");
  const std::string folder = "[folder]\ncommand = \"score\"\n";
  refused(folder, "pattern: is missing");
  refused(folder + "pattern = \"none/*.vdb\"\n", "matches no file");
  refused(folder + "pattern = \"t.vdb\"\n", "no wildcard");
  refused(folder + "pattern = \"**/t.vdb\"\n", "'**'");
  refused(folder + "pattern = \"*.vdb\"\narguments = { prepared = \"t.vdb\" }\n", "{file}");
  EXPECT_THROW(read_manifest(path("no.toml"), commands()), InputError);
}

}  // namespace
}  // namespace toothprep
