#include "toothprep/tools/batch/manifest.h"

#include <fnmatch.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>

#include "toothprep/step/core/number_text.h"
#include "toothprep/step/core/strict_toml.h"

namespace toothprep {
namespace {
namespace fs = std::filesystem;

template <class T>
bool contains(const std::vector<T>& list, const T& value) {
  return std::find(list.begin(), list.end(), value) != list.end();
}

std::string with_dashes(std::string key) {
  std::replace(key.begin(), key.end(), '_', '-');
  return key;
}

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size())
    text.replace(at, what.size(), by);
  return text;
}

// An argument as the manifest has it: one or more texts, or a switch.
struct Argument {
  std::vector<std::string> values;
  bool is_switch = false, on = false;
  std::string place;  // for errors
};
using Arguments = std::map<std::string, Argument>;  // by option, with dashes

// A text or number; nothing for what is neither.
std::optional<std::string> value_text(const toml::node& node) {
  if (const auto* text = node.as_string()) return text->get();
  if (const auto* integer = node.as_integer()) return std::to_string(integer->get());
  if (const auto* real = node.as_floating_point()) return shortest_text(real->get());
  return {};
}

Arguments read_arguments(const toml::table* table, const std::string& where,
                         const std::string& path) {
  Arguments arguments;
  if (!table) return arguments;
  for (const auto& [key, node] : *table) {
    const std::string option = with_dashes(std::string(key.str()));
    Argument a;
    a.place = path + "." + std::string(key.str()).substr(0, 60);
    if (const auto* flag = node.as_boolean()) {
      a.is_switch = true;
      a.on = flag->get();
    } else if (const auto value = value_text(node)) {
      a.values = {*value};
    } else if (const toml::array* list = node.as_array(); list && !list->empty()) {
      bool numbers = true;
      std::string joined;
      for (const toml::node& entry : *list) {
        const auto text = value_text(entry);
        if (!text) throw InputError(where, a.place, "must hold numbers or texts only");
        numbers = numbers && !entry.is_string();
        joined += (joined.empty() ? "" : ",") + *text;
        a.values.push_back(*text);
      }
      if (numbers) a.values = {joined};  // a list of numbers is one value with commas
    } else {
      throw InputError(where, a.place,
                       "must be a text, a number, true or false, or a list of them");
    }
    if (!arguments.emplace(option, std::move(a)).second)
      throw InputError(where, path + "." + std::string(key.str()), "is given twice, with _ and -");
  }
  return arguments;
}

class Reader {
 public:
  Reader(const std::string& path, const std::vector<BatchCommand>& commands) : where_(path) {
    manifest_.commands = commands;
    base_ = fs::absolute(path).lexically_normal().parent_path();
  }

  BatchManifest read() {
    const toml::table root = parse_toml(read_small_text(where_), where_);
    StrictTable top(root, where_);
    if (auto defaults = top.table("defaults")) {
      default_command_ = command_of(*defaults);
      check_table(*defaults, "arguments");
      defaults_ =
          read_arguments(root["defaults"]["arguments"].as_table(), where_, "defaults.arguments");
      defaults->done();
    }
    if (auto tables = top.tables("item")) {
      const toml::array& nodes = *root["item"].as_array();
      for (std::size_t i = 0; i < tables->size(); ++i)
        read_item((*tables)[i], *nodes.get(i)->as_table());
    }
    if (auto folder = top.table("folder")) read_folder(*folder, *root["folder"].as_table());
    top.done();
    if (manifest_.items.empty())
      throw InputError(where_, "", "names no item",
                       "add an [[item]] with name, command and arguments, or a [folder]");
    for (const auto& [option, argument] : defaults_)
      if (std::none_of(manifest_.items.begin(), manifest_.items.end(),
                       [&, &name = option](const BatchItem& item) {
                         return knows(manifest_.commands[item.command], name);
                       }))
        unknown_option(manifest_.commands[manifest_.items[0].command], option, argument.place);
    return std::move(manifest_);
  }

 private:
  // The key is known, and what stands there is a table.
  static void check_table(StrictTable& table, const std::string& key) { table.table(key); }

  std::optional<std::size_t> command_of(StrictTable& table) {
    std::vector<std::string> names;
    for (const BatchCommand& c : manifest_.commands) names.push_back(c.name);
    const auto name = table.choice("command", names);
    if (!name) return {};
    return std::find(names.begin(), names.end(), *name) - names.begin();
  }

  std::size_t needed_command(StrictTable& table) {
    const auto own = command_of(table);
    if (!own && !default_command_) table.missing("command", "\"score\"");
    return own ? *own : *default_command_;
  }

  static bool knows(const BatchCommand& command, const std::string& option) {
    return command.options.empty() || contains(command.options, option);
  }

  [[noreturn]] void unknown_option(const BatchCommand& command, const std::string& option,
                                   const std::string& place) const {
    throw InputError(where_, place, "is no option of '" + command.name + "'",
                     "did you mean '" + nearest_name(option, command.options) + "'?");
  }

  void add_item(const std::string& name, std::size_t command_index, const Arguments& own,
                const std::string& place) {
    const BatchCommand& command = manifest_.commands[command_index];
    check_name(name, place);
    BatchItem item;
    item.name = name;
    item.command = command_index;
    item.made = command.made;
    item.made.push_back(command.result);
    Arguments all;
    for (const auto& [option, argument] : own) {
      if (!knows(command, option)) unknown_option(command, option, argument.place);
      all.insert({option, argument});
    }
    for (const auto& [option, argument] : defaults_)
      if (knows(command, option)) all.insert({option, argument});
    for (const auto& [option, argument] : all) add_argument(item, command, option, argument);
    manifest_.items.push_back(std::move(item));
  }

  void add_argument(BatchItem& item, const BatchCommand& command, const std::string& option,
                    const Argument& argument) {
    static const std::vector<std::string> kReserved = {"output", "o",        "force",   "quiet",
                                                       "q",      "json",     "threads", "help",
                                                       "h",      "help-all", "version"};
    if (contains(kReserved, option))
      throw InputError(where_, argument.place, "is set by the batch itself", "leave it out");
    const std::string dashed = "--" + option;
    const auto put = [&](const std::string& shown, const std::string& real) {
      item.shown.push_back(shown);
      item.arguments.push_back(real);
    };
    for (const auto& [output, file] : command.outputs)
      if (output == option) {
        if (!argument.is_switch)
          throw InputError(where_, argument.place, "is written to the item's own folder",
                           "write " + option + " = true");
        if (!argument.on) return;
        put(dashed, dashed);
        put(file, file);
        item.made.push_back(file);
        return;
      }
    const bool input = contains(command.inputs, option),
               maybe = contains(command.maybe_inputs, option);
    if (argument.is_switch) {
      if (input || maybe) throw InputError(where_, argument.place, "must name a file");
      if (argument.on) put(dashed, dashed);
      return;
    }
    put(dashed, dashed);
    for (const std::string& raw : argument.values) {
      const std::string value = replaced(raw, "{name}", item.name);
      if (!input && !maybe) {
        // A value that begins with a dash would be taken for an option.
        if (value.rfind('-', 0) == 0) {
          item.shown.back() += "=" + value;
          item.arguments.back() += "=" + value;
        } else {
          put(value, value);
        }
        continue;
      }
      const fs::path path = (base_ / value).lexically_normal();
      std::error_code error;
      const bool file = !value.empty() && fs::is_regular_file(path, error);
      if (input && !file)
        throw InputError(where_, argument.place,
                         "item '" + item.name + "': there is no file " + path.string(),
                         "paths are relative to the manifest");
      put(value, file ? path.string() : value);
      if (file) item.inputs.push_back({value, path.string()});
    }
  }

  void check_name(const std::string& name, const std::string& place) {
    const auto refuse = [&](const std::string& condition) {
      throw InputError(where_, place, "the name '" + name.substr(0, 100) + "' " + condition,
                       "an item's name is that of its folder");
    };
    if (name.empty()) refuse("is empty");
    if (name.size() > 100) refuse("is longer than 100 bytes");
    if (name.find('/') != std::string::npos || name.find('\\') != std::string::npos)
      refuse("holds a slash");
    if (name.find("..") != std::string::npos) refuse("holds '..'");
    if (name[0] == '.' || name[0] == '-') refuse("begins with a dot or dash");
    if (std::any_of(name.begin(), name.end(), [](unsigned char c) { return c < 32 || c == 127; }))
      refuse("holds a control character");
    if (name.ends_with(".part") || name == "batch.csv" || name == "batch.json")
      refuse("is one that the batch itself uses");
    if (!names_.insert(name).second) refuse("is used twice");
  }

  void read_item(StrictTable& table, const toml::table& node) {
    const auto name = table.text("name");
    if (!name) table.missing("name", "\"anna\"");
    const std::size_t command = needed_command(table);
    check_table(table, "arguments");
    table.done();
    add_item(*name, command,
             read_arguments(node["arguments"].as_table(), where_, table.path_of("arguments")),
             table.path_of("name"));
  }

  // What matches a pattern of one path component each: the file and what its wildcards stand for.
  struct Match {
    fs::path file;
    std::string name;
  };
  void walk(const fs::path& at, const std::vector<std::string>& parts, std::size_t i,
            const std::string& name, std::vector<Match>& matches) const {
    std::error_code error;
    if (i == parts.size()) {
      if (fs::is_regular_file(at, error)) matches.push_back({at, name});
      return;
    }
    if (parts[i].find_first_of("*?[") == std::string::npos)
      return walk(at / parts[i], parts, i + 1, name, matches);
    std::vector<std::string> entries;
    for (const auto& entry : fs::directory_iterator(at, error))
      entries.push_back(entry.path().filename().string());
    std::sort(entries.begin(), entries.end());
    for (const std::string& entry : entries)
      if (fnmatch(parts[i].c_str(), entry.c_str(), FNM_PERIOD) == 0) {
        const bool last = i + 1 == parts.size();
        const std::string part = last ? fs::path(entry).stem().string() : entry;
        walk(at / entry, parts, i + 1, name.empty() ? part : name + "-" + part, matches);
      }
  }

  void read_folder(StrictTable& table, const toml::table& node) {
    const auto pattern = table.text("pattern");
    if (!pattern) table.missing("pattern", "\"students/*/prepared.vdb\"");
    const std::size_t command_index = needed_command(table);
    const BatchCommand& command = manifest_.commands[command_index];
    check_table(table, "arguments");
    table.done();
    if (pattern->find("**") != std::string::npos)
      table.refuse("pattern", "holds '**', which is not offered", "write one * for each folder");
    if (pattern->find_first_of("*?[") == std::string::npos)
      table.refuse("pattern", "holds no wildcard (*, ?, [])", "use an [[item]] for one file");
    std::vector<std::string> parts;
    for (const fs::path& part : fs::path(*pattern).relative_path())
      if (!part.empty()) parts.push_back(part.string());
    std::vector<Match> matches;
    walk(fs::path(*pattern).is_absolute() ? fs::path("/") : base_, parts, 0, "", matches);
    if (matches.empty())
      table.refuse("pattern", "matches no file", "patterns are relative to the manifest");
    const Arguments common =
        read_arguments(node["arguments"].as_table(), where_, table.path_of("arguments"));
    for (const Match& match : matches) {
      const std::string shown = fs::path(*pattern).is_absolute()
                                    ? match.file.string()
                                    : match.file.lexically_relative(base_).string();
      Arguments own = common;
      bool used = false;
      for (auto& [option, argument] : own)
        for (std::string& value : argument.values) {
          used = used || value.find("{file}") != std::string::npos;
          value = replaced(value, "{file}", shown);
        }
      if (!used) {
        if (own.count(command.matched))
          throw InputError(where_, own[command.matched].place,
                           "is what the pattern's match would be given to",
                           "leave it out, or say with {file} where the match goes");
        own[command.matched] = {{shown}, false, false, table.path_of("pattern")};
      }
      add_item(match.name, command_index, own, table.path_of("pattern"));
    }
  }

  std::string where_;
  fs::path base_;
  BatchManifest manifest_;
  std::optional<std::size_t> default_command_;
  Arguments defaults_;
  std::set<std::string> names_;
};

}  // namespace

std::vector<BatchCommand> batch_commands() {
  BatchCommand replay;
  replay.name = "replay";
  replay.inputs = {"tooth", "trajectory", "params"};
  replay.maybe_inputs = {"bur"};
  replay.outputs = {{"prepared", "prepared.vdb"}};
  replay.matched = "trajectory";
  replay.always = {"--json", "-o", "trace.h5"};
  replay.result = "replay.json";
  replay.result_on_stdout = true;
  replay.made = {"trace.h5"};
  replay.unrepeatable = {"realtime_factor", "step_us_"};
  BatchCommand score;
  score.name = "score";
  score.inputs = {"original", "prepared", "target", "trace"};
  score.maybe_inputs = {"rubric"};
  score.outputs = {{"report", "report"}};
  score.matched = "prepared";
  score.always = {"-o", "score.json"};
  score.result = "score.json";
  return {replay, score};
}

BatchManifest read_manifest(const std::string& path, const std::vector<BatchCommand>& commands) {
  return Reader(path, commands).read();
}

}  // namespace toothprep
