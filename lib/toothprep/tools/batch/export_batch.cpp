#include "toothprep/tools/batch/export_batch.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/batch/arguments.h"

namespace toothprep {
namespace {
namespace fs = std::filesystem;

// For sh. Words of plain characters stay as they are.
std::string quoted(const std::string& word) {
  constexpr const char* kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=:,./@%";
  if (!word.empty() && word.find_first_not_of(kPlain) == std::string::npos) return word;
  return "'" + replaced(word, "'", "'\\''") + "'";
}

class Exporter {
 public:
  Exporter(const BatchManifest& manifest, const BatchOptions& options)
      : m_(manifest), o_(options), dir_(fs::absolute(options.folder).lexically_normal()) {}

  [[nodiscard]] fs::path folder_of(std::size_t i) const { return dir_ / m_.items[i].folder; }

  [[nodiscard]] std::string path_of(const BatchInput& input) const {
    return input.item ? (folder_of(*input.item) / input.path).string() : input.path;
  }

  // What follows the `cd` into the item's folder.
  [[nodiscard]] std::string line_of(std::size_t i) const {
    const BatchItem& item = m_.items[i];
    std::string line;
    for (const BatchFill& fill : item.fills) {
      line += "LC_ALL=C sed";
      for (std::size_t k = 0; k < item.values.size(); ++k)
        if (!item.values[k].empty())
          line +=
              " -e " + quoted("s/{" + m_.factors[k].name + "}/" + sed_text(item.values[k]) + "/g");
      line += " " + quoted(m_.text_files[fill.text]) + " > " + quoted(fill.file) + " && ";
    }
    for (const std::string& word :
         item_command(m_, i, o_, [&](const BatchInput& input) { return path_of(input); }))
      line += quoted(word) + " ";
    const BatchCommand& command = m_.commands[item.command];
    line +=
        command.result_on_stdout ? "> " + quoted(command.result) + " 2> log.txt" : "> log.txt 2>&1";
    if (line.find('\n') != std::string::npos)
      throw Error("--export: item '" + item.name +
                  "' has a line end in an argument, which a line of commands can't hold");
    return line;
  }

 private:
  // Behind the second slash of `s/{FACTOR}/.../`.
  static std::string sed_text(const std::string& value) {
    return replaced(replaced(replaced(value, "\\", "\\\\"), "/", "\\/"), "&", "\\&");
  }

  const BatchManifest& m_;
  const BatchOptions& o_;
  fs::path dir_;
};

// A text of Python, in which Snakemake finds nothing to replace.
std::string python_text(const std::string& text) {
  return nlohmann::json(replaced(replaced(text, "{", "{{"), "}", "}}"))
      .dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

// A path of a rule's input or output.
std::string python_path(const std::string& path) {
  if (path.find_first_of("{}") != std::string::npos)
    throw Error("--export snakemake: " + path +
                " has a brace in it, which Snakemake takes for a wildcard; name the item or folder "
                "otherwise");
  return python_text(path);
}

bool is_folder(const std::string& made) { return fs::path(made).extension().empty(); }

// What an item writes; a file in a folder that it writes is part of that.
std::vector<std::string> outputs_of(const BatchItem& item) {
  std::vector<std::string> outputs;
  for (const std::string& file : item.made)
    if (std::none_of(item.made.begin(), item.made.end(), [&](const std::string& other) {
          return is_folder(other) && file.rfind(other + "/", 0) == 0;
        }))
      outputs.push_back(file);
  return outputs;
}

std::string list_of(const std::vector<std::string>& entries) {
  std::string text;
  for (const std::string& entry : entries) text += "        " + entry + ",\n";
  return text;
}

// What a rule waits for.
std::vector<std::string> rule_inputs(const BatchManifest& m, const Exporter& exporter,
                                     std::size_t i) {
  const BatchItem& item = m.items[i];
  std::vector<std::string> inputs;
  const auto add = [&](const std::string& path) {
    const std::string text = python_path(path);
    if (std::find(inputs.begin(), inputs.end(), text) == inputs.end()) inputs.push_back(text);
  };
  std::set<std::size_t> named;
  for (const BatchInput& input : item.inputs) {
    std::string path = exporter.path_of(input);
    if (input.item) {
      named.insert(*input.item);
      for (const std::string& made : outputs_of(m.items[*input.item]))
        if (input.path.rfind(made + "/", 0) == 0)
          path = (exporter.folder_of(*input.item) / made).string();
    }
    add(path);
  }
  for (const BatchFill& fill : item.fills) add(m.text_files[fill.text]);
  for (const std::size_t need : item.needs)
    if (named.count(need) == 0)
      add((exporter.folder_of(need) / outputs_of(m.items[need]).front()).string());
  return inputs;
}

std::string rule_of(const BatchManifest& m, const Exporter& exporter, std::size_t i,
                    std::vector<std::string>& kept) {
  const BatchItem& item = m.items[i];
  const fs::path folder = exporter.folder_of(i);
  std::vector<std::string> outputs;
  for (const std::string& file : outputs_of(item)) {
    const std::string path = python_path((folder / file).string());
    const bool keep = is_folder(file) || keeps(item.keep, file);
    outputs.push_back(is_folder(file) ? "directory(" + path + ")"
                      : keep          ? path
                                      : "temp(" + path + ")");
    if (keep) kept.push_back(path);
  }
  const std::vector<std::string> inputs = rule_inputs(m, exporter, i);
  std::string text = fmt::format("\nrule item_{}:  # {}\n", i, item.name);
  if (!inputs.empty()) text += "    input:\n" + list_of(inputs);
  text += "    output:\n" + list_of(outputs);
  text += "    log: " + python_text((folder / "log.txt").string()) + "\n    threads: 1\n";
  return text + "    shell: " +
         python_text("cd " + quoted(folder.string()) + " && " + exporter.line_of(i)) + "\n";
}

std::vector<std::size_t> all_items(const BatchManifest& m) {
  std::vector<std::size_t> all(m.items.size());
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
  return all;
}

}  // namespace

std::vector<std::string> item_command(
    const BatchManifest& m, std::size_t i, const BatchOptions& o,
    const std::function<std::string(const BatchInput&)>& path_of) {
  const BatchItem& item = m.items[i];
  const BatchCommand& command = m.commands[item.command];
  const std::size_t space = command.name.find(' ');
  std::vector<std::string> line = {o.program, command.name.substr(0, space)};
  line.insert(line.end(), o.program_arguments.begin(), o.program_arguments.end());
  if (space != std::string::npos) line.push_back(command.name.substr(space + 1));
  line.insert(line.end(), command.always.begin(), command.always.end());
  std::vector<std::string> arguments = item.arguments;
  for (const BatchInput& input : item.inputs)
    if (input.item) arguments[input.argument] = input.before + path_of(input);
  line.insert(line.end(), arguments.begin(), arguments.end());
  return line;
}

std::vector<std::vector<std::size_t>> items_by_level(const BatchManifest& m,
                                                     const std::vector<std::size_t>& items) {
  constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  std::vector<std::size_t> level(m.items.size(), kNone);
  std::vector<bool> concerned(m.items.size(), false);
  for (const std::size_t i : items) concerned[i] = true;
  std::vector<std::vector<std::size_t>> levels;
  for (const std::size_t first : items) {
    std::vector<std::size_t> open = {first};  // what it needs comes first
    while (!open.empty()) {
      const std::size_t i = open.back();
      std::size_t own = 0;
      bool ready = true;
      for (const std::size_t need : m.items[i].needs) {
        if (!concerned[need]) continue;
        if (level[need] == kNone) {
          open.push_back(need);
          ready = false;
        } else {
          own = std::max(own, level[need] + 1);
        }
      }
      if (!ready) continue;
      open.pop_back();
      if (level[i] != kNone) continue;
      level[i] = own;
      if (levels.size() <= own) levels.resize(own + 1);
      levels[own].push_back(i);
    }
  }
  for (auto& of_level : levels) std::sort(of_level.begin(), of_level.end());
  return levels;
}

std::string shell_commands(const BatchManifest& m, const BatchOptions& o) {
  const Exporter exporter(m, o);
  const auto levels = items_by_level(m, all_items(m));
  std::string text = fmt::format("# toothprep {}: {} items in {} level{}, a line each\n", o.version,
                                 m.items.size(), levels.size(), levels.size() == 1 ? "" : "s");
  for (std::size_t n = 0; n < levels.size(); ++n) {
    text += fmt::format("# level {}: {} items{}\n", n + 1, levels[n].size(),
                        n == 0 ? "" : ", which need items of levels before: wait for their end");
    for (const std::size_t i : levels[n]) {
      const fs::path folder = exporter.folder_of(i);
      text += "mkdir -p " + quoted(folder.parent_path().string()) + " && mkdir " +
              quoted(folder.string()) + " && cd " + quoted(folder.string()) + " && " +
              exporter.line_of(i) + "\n";
    }
  }
  return text;
}

std::string snakefile(const BatchManifest& m, const BatchOptions& o) {
  const Exporter exporter(m, o);
  std::vector<std::string> kept;
  std::string rules;
  for (std::size_t i = 0; i < m.items.size(); ++i) rules += rule_of(m, exporter, i, kept);
  return fmt::format("# toothprep {}: {} items\n# snakemake -s THIS_FILE --cores all\nrule all:\n",
                     o.version, m.items.size()) +
         "    input:\n" + list_of(kept) + rules;
}

}  // namespace toothprep
