#include "toothprep/tools/batch/manifest.h"

#include <fnmatch.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>
#include <unordered_map>

#include "toothprep/step/core/hash.h"
#include "toothprep/step/core/strict_toml.h"
#include "toothprep/tools/batch/arguments.h"
#include "toothprep/tools/batch/sweep.h"

namespace toothprep {
namespace {
namespace fs = std::filesystem;

template <class T>
bool contains(const std::vector<T>& list, const T& value) {
  return std::find(list.begin(), list.end(), value) != list.end();
}

// A value that is another item's output, "{ITEM/FILE}", with what stands before it.
struct Reference {
  std::string before, item, file;
};
std::optional<Reference> reference_in(const std::string& value) {
  const std::size_t open = value.find('{'),
                    slash = value.find('/', open == std::string::npos ? 0 : open);
  if (open == std::string::npos || slash == std::string::npos || value.back() != '}') return {};
  return Reference{value.substr(0, open), value.substr(open + 1, slash - open - 1),
                   value.substr(slash + 1, value.size() - slash - 2)};
}

std::string digits_of(const std::string& text, std::size_t count) {
  Sha256 hash;
  hash.update(text.data(), text.size());
  return hash.hex().substr(0, count);
}

class Reader {
 public:
  Reader(const std::string& path, const std::vector<BatchCommand>& commands) : where_(path) {
    manifest_.commands = commands;
    base_ = fs::absolute(path).lexically_normal().parent_path();
    manifest_.base = base_.string();
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
    if (auto sweep = top.table("sweep")) add_sweep(*sweep, *root["sweep"].as_table());
    top.done();
    if (manifest_.items.empty())
      throw InputError(where_, "", "names no item",
                       "add an [[item]] with name, command and arguments, a [folder] or a [sweep]");
    for (const auto& [option, argument] : defaults_)
      if (std::none_of(manifest_.items.begin(), manifest_.items.end(),
                       [&, &name = option](const BatchItem& item) {
                         return knows(manifest_.commands[item.command], name);
                       }))
        unknown_option(manifest_.commands[manifest_.items[0].command], option, argument.place);
    link();
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

  // Where an item comes from.
  struct Origin {
    std::string place;                 // for errors
    const SweepItem* swept = nullptr;  // of a sweep
    const SweepStep* step = nullptr;
    std::size_t first = 0;  // of a sweep: the place of its first item in the manifest
  };

  BatchItem& add_item(const std::string& name, std::size_t command_index, const BatchArguments& own,
                      const Origin& origin) {
    const BatchCommand& command = manifest_.commands[command_index];
    check_name(name, origin.place);
    BatchItem item;
    item.name = item.folder = name;
    item.command = command_index;
    item.made = command.made;
    if (!command.result.empty()) item.made.push_back(command.result);
    BatchArguments all;
    for (const auto& [option, argument] : own) {
      if (!knows(command, option)) unknown_option(command, option, argument.place);
      all.insert({option, argument});
    }
    if (!origin.swept)  // a step of a sweep has them already
      for (const auto& [option, argument] : defaults_)
        if (knows(command, option)) all.insert({option, argument});
    // What has no option before it must not follow one that takes several values.
    if (const auto first = all.find(command.positional); first != all.end()) {
      add_argument(item, command, first->first, first->second, origin);
      all.erase(first);
    }
    for (const auto& [option, argument] : all)
      add_argument(item, command, option, argument, origin);
    manifest_.items.push_back(std::move(item));
    return manifest_.items.back();
  }

  void add_argument(BatchItem& item, const BatchCommand& command, const std::string& option,
                    const BatchArgument& argument, const Origin& origin) {
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
    if (option != command.positional) put(dashed, dashed);
    if (origin.step && contains(origin.step->fill, option)) {
      const std::string file = option + fs::path(argument.values[0]).extension().string();
      item.fills.push_back({file, fill_text(argument)});
      return put(file, file);
    }
    for (const std::string& raw : argument.values) {
      const std::string value = replaced(raw, "{name}", item.name);
      if (input || maybe)
        add_input(item, command, option, value, argument.place, origin);
      else if (value.rfind('-', 0) == 0) {
        // A value that begins with a dash would be taken for an option.
        item.shown.back() += "=" + value;
        item.arguments.back() += "=" + value;
      } else {
        put(value, value);
      }
    }
  }

  void add_input(BatchItem& item, const BatchCommand& command, const std::string& option,
                 const std::string& value, const std::string& place, const Origin& origin) {
    if (const auto other = reference_in(value)) {
      BatchInput made{value, other->file, {}, item.arguments.size(), other->before};
      if (origin.swept)
        if (const auto at = origin.swept->from.find(other->item); at != origin.swept->from.end())
          made.item = origin.first + at->second;
      links_.push_back({manifest_.items.size(), item.inputs.size(), other->item, place});
      item.inputs.push_back(std::move(made));
      item.shown.push_back(value);
      item.arguments.push_back(value);
      return;
    }
    const bool may_be_folder = contains(command.folders, option);
    std::string before, own = value;
    Kind kind = kind_of(own);
    // "enamel=FILE"
    if (const std::size_t equal = value.find('=');
        kind == Kind::kNone && equal != std::string::npos) {
      before = value.substr(0, equal + 1);
      own = value.substr(equal + 1);
      kind = kind_of(own);
    }
    const bool found = kind == Kind::kFile || (kind == Kind::kFolder && may_be_folder);
    const std::string path = (base_ / own).lexically_normal().string();
    if (!found && contains(command.inputs, option))
      throw InputError(where_, place, "item '" + item.name + "': there is no file " + path,
                       "paths are relative to the manifest");
    item.shown.push_back(value);
    item.arguments.push_back(found ? before + path : value);
    if (found) item.inputs.push_back({value, path});
  }

  enum class Kind { kNone, kFile, kFolder };
  // Asked once for each path: a sweep names the same files many times.
  Kind kind_of(const std::string& value) {
    if (value.empty()) return Kind::kNone;
    const auto [place, fresh] = kinds_.try_emplace(value, Kind::kNone);
    if (fresh) {
      std::error_code error;
      const fs::file_status status = fs::status(base_ / value, error);
      if (fs::is_regular_file(status)) place->second = Kind::kFile;
      if (fs::is_directory(status)) place->second = Kind::kFolder;
    }
    return place->second;
  }

  // Where the text of a file that is filled in stands among the manifest's.
  std::size_t fill_text(const BatchArgument& argument) {
    const std::string path = (base_ / argument.values[0]).lexically_normal().string();
    const auto [place, fresh] = texts_.try_emplace(path, manifest_.texts.size());
    if (fresh) {
      if (kind_of(argument.values[0]) != Kind::kFile)
        throw InputError(where_, argument.place, "there is no file " + path,
                         "paths are relative to the manifest");
      manifest_.texts.push_back(read_small_text(path));
      manifest_.text_files.push_back(path);
    }
    return place->second;
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
    if (name.ends_with(".part") || name == "batch.csv" || name == "batch.json" ||
        name == "batch.h5" || name == "summary.csv" || name == "index.html" || name == "points")
      refuse("is one that the batch itself uses");
    if (!names_.insert(name).second) refuse("is used twice");
  }

  void read_item(StrictTable& table, const toml::table& node) {
    const auto name = table.text("name");
    if (!name) table.missing("name", "\"anna\"");
    const std::size_t command = needed_command(table);
    check_table(table, "arguments");
    const auto after = table.texts("after").value_or(std::vector<std::string>{});
    const BatchKeep keep = read_keep(table);
    table.done();
    for (const std::string& other : after)
      links_.push_back({manifest_.items.size(), kAfter, other, table.path_of("after")});
    add_item(*name, command,
             read_arguments(node["arguments"].as_table(), where_, table.path_of("arguments")),
             {table.path_of("name")})
        .keep = keep;
  }

  std::vector<std::string> files_of(const std::string& pattern) const {
    std::vector<std::string> parts, files;
    for (const fs::path& part : fs::path(pattern).relative_path())
      if (!part.empty()) parts.push_back(part.string());
    std::vector<Match> matches;
    const bool absolute = fs::path(pattern).is_absolute();
    walk(absolute ? fs::path("/") : base_, parts, 0, "", matches);
    for (const Match& match : matches)
      files.push_back(absolute ? match.file.string()
                               : match.file.lexically_relative(base_).string());
    return files;
  }

  void add_sweep(StrictTable& table, const toml::table& node) {
    const Sweep sweep = read_sweep(node, table,
                                   {[&](StrictTable& step) {
                                      const auto own = command_of(step);
                                      return own ? own : default_command_;
                                    },
                                    [&](const std::string& pattern) { return files_of(pattern); },
                                    [&](std::size_t command, const std::string& option) {
                                      return knows(manifest_.commands[command], option);
                                    },
                                    &defaults_});
    std::vector<std::vector<std::string>> texts;
    for (const SweepStep& step : sweep.steps) {
      texts.emplace_back();
      for (const std::string& option : step.fill)
        texts.back().push_back(manifest_.texts[fill_text(step.arguments.at(option))]);
    }
    const SweepPlan plan = plan_sweep(sweep, texts, where_);
    manifest_.factors = plan.factors;
    manifest_.points = plan.points;
    const std::size_t first = manifest_.items.size();
    manifest_.items.reserve(first + plan.items.size());
    for (const SweepItem& swept : plan.items) {
      const SweepStep& step = sweep.steps[swept.step];
      for (const std::string& other : step.after)
        if (!swept.from.count(other))
          links_.push_back({manifest_.items.size(), kAfter, other, step.place});
      BatchItem& item = add_item(swept.name, step.command, filled(step, plan, swept),
                                 {step.place, &swept, &step, first});
      item.folder = "points/" + digits_of(item.name, 2) + "/" + item.name;
      item.step = step.name;
      item.values = swept.values;
      item.keep = step.keep;
      for (const auto& [name, index] : swept.from) item.needs.push_back(first + index);
    }
  }

  // The step's arguments with the values of its factors.
  BatchArguments filled(const SweepStep& step, const SweepPlan& plan, const SweepItem& item) const {
    BatchArguments own = step.arguments;
    for (auto& [option, argument] : own)
      for (std::string& value : argument.values) {
        if (value.find('{') == std::string::npos) continue;
        for (std::size_t k = 0; k < plan.factors.size(); ++k)
          if (!item.values[k].empty())
            value = replaced(value, "{" + plan.factors[k].name + "}", item.values[k]);
        const std::size_t open = value.find('{'), close = value.find('}', open);
        const std::string left =
            close == std::string::npos ? "" : value.substr(open + 1, close - open - 1);
        if (!left.empty() && left != "name" && left.find('/') == std::string::npos)
          throw InputError(where_, argument.place, "{" + left.substr(0, 60) + "} is no factor",
                           "name it in [sweep.over]");
      }
    return own;
  }

  // What items need of one another, by name; none may need itself, through whatever others.
  void link() {
    std::unordered_map<std::string, std::size_t> place;
    for (std::size_t i = 0; i < manifest_.items.size(); ++i) place[manifest_.items[i].name] = i;
    for (const Link& l : links_) {
      BatchItem& item = manifest_.items[l.item];
      std::optional<std::size_t> other;
      if (l.input != kAfter) other = item.inputs[l.input].item;
      if (!other) {
        const auto found = place.find(l.name);
        if (found == place.end())
          throw InputError(
              where_, l.place,
              "item '" + item.name + "' needs '" + l.name.substr(0, 100) + "', which is no item",
              "name an item or a step of the sweep");
        other = found->second;
      }
      item.needs.push_back(*other);
      if (l.input == kAfter) continue;
      BatchInput& input = item.inputs[l.input];
      input.item = other;
      check_made(manifest_.items[*other], input.path, l.place);
    }
    for (BatchItem& item : manifest_.items) {
      std::sort(item.needs.begin(), item.needs.end());
      item.needs.erase(std::unique(item.needs.begin(), item.needs.end()), item.needs.end());
    }
    refuse_cycles();
  }

  void check_made(const BatchItem& other, const std::string& file, const std::string& place) const {
    const std::string top = file.substr(0, file.find('/'));
    if (contains(other.made, file) ||
        (contains(other.made, top) && file.find("..") == std::string::npos))
      return;
    std::string made;
    for (const std::string& name : other.made) made += (made.empty() ? "" : ", ") + name;
    throw InputError(where_, place, "'" + other.name + "' writes no '" + file + "', but " + made,
                     "outputs that are optional are named there with true");
  }

  void refuse_cycles() const {
    const std::vector<BatchItem>& items = manifest_.items;
    std::vector<std::vector<std::size_t>> needed_by(items.size());
    std::vector<std::size_t> open(items.size()), ready;
    for (std::size_t i = 0; i < items.size(); ++i) {
      open[i] = items[i].needs.size();
      for (const std::size_t n : items[i].needs) needed_by[n].push_back(i);
      if (open[i] == 0) ready.push_back(i);
    }
    std::size_t placed = 0;
    for (; !ready.empty(); ++placed) {
      const std::size_t i = ready.back();
      ready.pop_back();
      for (const std::size_t d : needed_by[i])
        if (--open[d] == 0) ready.push_back(d);
    }
    if (placed == items.size()) return;
    std::string names;
    for (std::size_t i = 0; i < items.size() && names.size() < 200; ++i)
      if (open[i] > 0) names += (names.empty() ? "" : ", ") + items[i].name;
    throw InputError(where_, "", "items need one another: " + names, "break the circle");
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
    const BatchKeep keep = read_keep(table);
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
    const BatchArguments common =
        read_arguments(node["arguments"].as_table(), where_, table.path_of("arguments"));
    for (const Match& match : matches) {
      const std::string shown = fs::path(*pattern).is_absolute()
                                    ? match.file.string()
                                    : match.file.lexically_relative(base_).string();
      BatchArguments own = common;
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
      add_item(match.name, command_index, own, {table.path_of("pattern")}).keep = keep;
    }
  }

  std::string where_;
  fs::path base_;
  BatchManifest manifest_;
  std::optional<std::size_t> default_command_;
  BatchArguments defaults_;
  std::set<std::string> names_;
  std::map<std::string, Kind> kinds_;
  std::map<std::string, std::size_t> texts_;  // by path
  // An item, which of its inputs (or kAfter), and the name of the item that it needs.
  struct Link {
    std::size_t item, input;
    std::string name, place;
  };
  static constexpr std::size_t kAfter = static_cast<std::size_t>(-1);
  std::vector<Link> links_;
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
  std::vector<BatchCommand> commands = {replay, score};

  BatchCommand voxelize;
  voxelize.name = "voxelize";
  voxelize.inputs = {"scan", "mesh"};
  voxelize.folders = {"scan"};
  voxelize.positional = voxelize.matched = "scan";
  voxelize.outputs = {{"report", "report"}};
  voxelize.always = {"--json", "-o", "tooth.vdb"};
  voxelize.result = "voxelize.json";
  voxelize.result_on_stdout = true;
  voxelize.made = {"tooth.vdb"};
  commands.push_back(voxelize);

  BatchCommand calibrate;
  calibrate.name = "calibrate";
  calibrate.inputs = {"tooth", "measured", "params"};
  calibrate.maybe_inputs = {"bur"};
  calibrate.outputs = {{"report", "report"}, {"params-out", "fit.toml"}};
  calibrate.matched = "measured";
  calibrate.always = {"-o", "fit.json"};
  calibrate.result = "fit.json";
  commands.push_back(calibrate);

  BatchCommand figures;
  figures.name = "figures";
  figures.inputs = {"params", "experiments"};
  figures.folders = {"experiments"};
  figures.matched = "params";
  figures.always = {"-o", "figures"};
  figures.result = "figures/figures.json";
  figures.made = {"figures"};
  commands.push_back(figures);

  for (const char* kind : {"block", "molar", "scan", "cavity", "measurement"}) {
    BatchCommand specimen;
    specimen.name = std::string("specimen ") + kind;
    specimen.matched = "trajectory";
    specimen.made = {"tooth.vdb"};
    if (specimen.name == "specimen scan") {
      specimen.made = {"scan.nrrd"};
      specimen.outputs = {{"labels", "labels.nrrd"}};
    } else if (specimen.name == "specimen cavity") {
      specimen.made = {"prepared.vdb"};
      specimen.outputs = {{"original", "original.vdb"}, {"target", "target.vdb"}};
      specimen.result = "truth.json";
    } else if (specimen.name == "specimen measurement") {
      specimen.inputs = {"tooth", "trajectory", "params"};
      specimen.maybe_inputs = {"bur"};
      specimen.made = {"measurement.h5"};
    }
    specimen.always = {"-o", specimen.made[0]};
    if (!specimen.result.empty())
      specimen.always.insert(specimen.always.end(), {"--truth", specimen.result});
    commands.push_back(specimen);
  }
  return commands;
}

bool keeps(BatchKeep keep, const std::string& file) {
  const std::string end = fs::path(file).extension().string();
  return keep == BatchKeep::kAll || (keep == BatchKeep::kTrace && end == ".h5") ||
         contains(std::vector<std::string>{".json", ".csv", ".toml", ".txt", ".md"}, end);
}

std::string filled_text(const BatchManifest& manifest, const BatchItem& item,
                        const std::string& text) {
  std::string filled = text;
  for (std::size_t k = 0; k < item.values.size(); ++k)
    if (!item.values[k].empty())
      filled = replaced(filled, "{" + manifest.factors[k].name + "}", item.values[k]);
  return filled;
}

BatchManifest read_manifest(const std::string& path, const std::vector<BatchCommand>& commands) {
  return Reader(path, commands).read();
}

}  // namespace toothprep
