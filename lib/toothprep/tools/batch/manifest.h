// The manifest of a batch: which commands run on which files. README.md describes the format.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "toothprep/tools/batch/design.h"

namespace toothprep {

// What a batch must know of a command of the program.
struct BatchCommand {
  std::string name;                       // with a subcommand: "specimen molar"
  std::vector<std::string> options;       // its long options without dashes; empty: any
  std::vector<std::string> inputs;        // those that name a file that must exist
  std::vector<std::string> maybe_inputs;  // a file if there is one of that name, else just a word
  // Those that name a further output: given `true`, they write this file or folder of the item's.
  std::vector<std::pair<std::string, std::string>> outputs;
  std::string matched;              // the input that a [folder]'s match is given to
  std::vector<std::string> always;  // arguments of every item
  std::string result;               // the JSON file that the item's figures come from; or none
  bool result_on_stdout = false;    // the command prints it
  std::vector<std::string> made;    // other files that it always writes
  std::vector<std::string> unrepeatable;  // figures with these beginnings differ from run to run
  std::vector<std::string> folders = {};  // of the inputs, those that may be a folder
  std::string positional = {};            // the input that has no option before it
};

// replay, score, voxelize, calibrate, figures, and specimen with each of its subcommands.
std::vector<BatchCommand> batch_commands();

struct BatchInput {
  std::string shown;  // as in the manifest
  std::string path;   // absolute; of another item's output: in that item's folder
  std::optional<std::size_t> item = {};  // whose output it is
  std::size_t argument = 0;              // of an output: the argument that becomes its path, ...
  std::string before = {};               // ... behind this text
};

// A text file of the item's folder, made of a text of the manifest's with the item's values.
struct BatchFill {
  std::string file;
  std::size_t text = 0;  // index into the manifest's texts
};

// What stays of an item's files, by their endings: all; of the score only tables and JSON (.json
// .csv .toml .txt .md); of the trace .h5, too.
enum class BatchKeep { kAll, kTrace, kScore };
bool keeps(BatchKeep keep, const std::string& file);

struct BatchItem {
  std::string name;
  std::string folder;       // below DIR
  std::size_t command = 0;  // index into the manifest's commands
  // Arguments, as shown in the manifest and as they run (inputs as absolute paths).
  std::vector<std::string> shown, arguments;
  std::vector<BatchInput> inputs;
  std::vector<std::string> made;   // what it must write, in its folder
  std::vector<std::size_t> needs;  // items that are to be done before it
  std::string step = {};           // of a sweep; else empty
  std::vector<std::string> values =
      {};  // of a sweep: by factor; empty where it makes no difference
  std::vector<BatchFill> fills = {};
  BatchKeep keep = BatchKeep::kAll;
};

struct BatchManifest {
  std::vector<BatchCommand> commands;
  std::vector<BatchItem> items;         // at least one; names are unique and good names of folders
  std::vector<Factor> factors;          // of the sweep; the last is "repeat" if there is one
  std::vector<std::string> texts;       // that are filled in
  std::vector<std::string> text_files;  // where they stand, absolute
  std::size_t points = 0;               // of the sweep
  std::string base;                     // the manifest's folder
};

// The text with {FACTOR} replaced by the item's values.
std::string filled_text(const BatchManifest& manifest, const BatchItem& item,
                        const std::string& text);

// Throws InputError: not TOML, unknown keys, commands or options (with the nearest known one), a
// missing input, names that are used twice or are no name of a folder, items that need one another,
// outputs that nobody writes, factors that nothing uses, no item at all.
BatchManifest read_manifest(const std::string& path, const std::vector<BatchCommand>& commands);

}  // namespace toothprep
