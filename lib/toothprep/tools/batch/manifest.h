// The manifest of a batch: which commands run on which files. README.md describes the format.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace toothprep {

// What a batch must know of a command of the program.
struct BatchCommand {
  std::string name;
  std::vector<std::string> options;       // its long options without dashes; empty: any
  std::vector<std::string> inputs;        // those that name a file that must exist
  std::vector<std::string> maybe_inputs;  // a file if there is one of that name, else just a word
  // Those that name a further output: given `true`, they write this file or folder of the item's.
  std::vector<std::pair<std::string, std::string>> outputs;
  std::string matched;                    // the input that a [folder]'s match is given to
  std::vector<std::string> always;        // arguments of every item
  std::string result;                     // the JSON file that the item's figures come from
  bool result_on_stdout = false;          // the command prints it
  std::vector<std::string> made;          // other files that it always writes
  std::vector<std::string> unrepeatable;  // figures with these beginnings differ from run to run
};

// `replay` and `score`.
std::vector<BatchCommand> batch_commands();

struct BatchInput {
  std::string shown;  // as in the manifest
  std::string path;   // absolute
};

struct BatchItem {
  std::string name;
  std::size_t command = 0;  // index into the manifest's commands
  // Arguments, as shown in the manifest and as they run (inputs as absolute paths).
  std::vector<std::string> shown, arguments;
  std::vector<BatchInput> inputs;
  std::vector<std::string> made;  // what it must write, in its folder
};

struct BatchManifest {
  std::vector<BatchCommand> commands;
  std::vector<BatchItem> items;  // at least one; names are unique and good names of folders
};

// Throws InputError: not TOML, unknown keys, commands or options (with the nearest known one), a
// missing input, names that are used twice or are no name of a folder, no item at all.
BatchManifest read_manifest(const std::string& path, const std::vector<BatchCommand>& commands);

}  // namespace toothprep
