#include "toothprep/tools/recordings/column_roles.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <set>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/nearest_name.h"

namespace toothprep {
namespace {

using Words = std::vector<std::string>;

bool one_of(const std::string& word, const std::vector<std::string>& words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

const std::vector<std::string> kUnits = {"s",     "sec",   "ms", "us",  "µs",  "ns",  "mm",
                                         "cm",    "m",     "um", "µm",  "in",  "n",   "mn",
                                         "gf",    "g",     "kg", "kgf", "deg", "rad", "rpm",
                                         "rev/s", "1/min", "hz", "°",   "mnm", "nm",  "nmm"};
const std::vector<std::string> kPosition = {"pos", "position", "p",           "tip",
                                            "tcp", "trans",    "translation", "t",
                                            "loc", "location", "coord",       "coordinate"};
const std::vector<std::string> kQuaternion = {"q", "quat", "quaternion", "ori", "orientation"};
const std::vector<std::string> kAngles = {"r", "rot", "rotation", "euler", "angle"};
const std::vector<std::string> kForce = {"f", "force", "forces"};
const std::vector<std::string> kOther = {"v",     "vel",          "velocity", "speed",  "acc",
                                         "accel", "acceleration", "torque",   "moment", "m",
                                         "tau",   "angular",      "omega",    "linear"};
const std::vector<std::string> kTime = {"time", "timestamp", "stamp", "t", "zeit", "elapsed"};
const std::vector<std::string> kBur = {"tip", "bur",    "burr",   "drill",  "tool",
                                       "tcp", "handle", "stylus", "device", "instrument"};

// "PosX (mm)" -> words {"pos", "x"}, unit "mm".
struct Name {
  Words words;
  std::string unit;
};

bool is_upper(char c) { return std::isupper(static_cast<unsigned char>(c)) != 0; }
bool is_word(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) || static_cast<unsigned char>(c) >= 0x80;
}

Words words_of(const std::string& text) {
  Words words;
  std::string word;
  const auto end = [&] {
    if (!word.empty()) words.push_back(lower(word));
    word.clear();
  };
  for (std::size_t i = 0; i < text.size(); ++i) {
    const bool hump = i > 0 && is_upper(text[i]) && !is_upper(text[i - 1]) && is_word(text[i - 1]);
    if (!is_word(text[i]) || hump) end();
    if (is_word(text[i])) word += text[i];
  }
  end();
  return words;
}

Name parse(const std::string& column) {
  Name name;
  std::string text = column;
  const std::size_t opens = text.find_last_of("([");
  if (opens != std::string::npos && opens > 0) {
    const std::size_t closes = text.find_first_of(")]", opens);
    name.unit = text.substr(opens + 1, closes == std::string::npos ? closes : closes - opens - 1);
    text.resize(opens);
    if (!one_of(lower(name.unit), kUnits)) name.unit.clear();
  }
  if (const std::size_t slash = text.rfind('/'); slash != std::string::npos && slash > 0 &&
                                                 name.unit.empty() &&
                                                 one_of(lower(text.substr(slash + 1)), kUnits)) {
    name.unit = text.substr(slash + 1);
    text.resize(slash);
  }
  if (name.unit.empty()) {  // x_mm, FzN is no unit: that N may be anything
    const std::size_t bar = text.find_last_of("_ ");
    if (bar != std::string::npos && bar > 0 && one_of(lower(text.substr(bar + 1)), kUnits)) {
      name.unit = text.substr(bar + 1);
      text.resize(bar);
    }
  }
  if (text.ends_with("rev_s")) name.unit = "rev/s", text.resize(text.size() - 5);
  name.words = words_of(text);
  return name;
}

// What a name says: the key of its quantity, and what stands before it ("drill").
struct Meaning {
  std::string key, prefix;
  bool scalar_first = false;
};

std::string joined(const Words& words, std::size_t count) {
  std::string text;
  for (std::size_t i = 0; i < count; ++i) text += (i ? "_" : "") + words[i];
  return text;
}

// {"drill", "posx"} -> {"drill", "pos", "x"}.
Words with_axis_apart(Words words) {
  std::string& last = words.back();
  if (last.size() < 2) return words;
  const std::string stem = last.substr(0, last.size() - 1), axis = last.substr(last.size() - 1);
  if (!one_of(axis, {"x", "y", "z", "w"})) return words;
  for (const auto* known : {&kPosition, &kQuaternion, &kAngles, &kForce, &kOther, &kBur})
    if (one_of(stem, *known)) {
      last = stem;
      words.push_back(axis);
      break;
    }
  return words;
}

Meaning meaning_of_axis(const Words& words) {
  const std::string& axis = words.back();
  const std::size_t before = words.size() - 1;
  for (std::size_t i = before; i-- > 0;) {
    const std::string& word = words[i];
    const std::string prefix = joined(words, i);
    if (one_of(word, kOther)) return {};
    if (one_of(word, kQuaternion)) return {"q" + axis, prefix};
    if (one_of(word, kAngles)) return {(axis == "w" ? "q" : "r") + axis, prefix};
    if (one_of(word, kForce)) return {"f" + axis, prefix};
    if (one_of(word, kPosition) && !one_of(word, kBur)) return {axis, prefix};
    if (word == "axis") return {"axis_" + axis, joined(words, i)};
  }
  return {axis == "w" ? "qw" : axis, joined(words, before)};
}

Meaning meaning_of(const Name& name) {
  if (name.words.empty()) return {};
  const Words words = with_axis_apart(name.words);
  const std::string& last = words.back();
  const std::string prefix = joined(words, words.size() - 1);
  if (one_of(last, {"x", "y", "z", "w"})) return meaning_of_axis(words);
  if (one_of(last, {"roll", "pitch", "yaw"}))
    return {last == "roll" ? "rx" : last == "pitch" ? "ry" : "rz", prefix};
  if (one_of(last, {"q0", "q1", "q2", "q3"})) return {"quaternion_" + last.substr(1), prefix};
  if (last.size() == 3 && (last[0] == 'r' || last[0] == 'm') && std::isdigit(last[1]) &&
      std::isdigit(last[2]))
    return {"matrix_" + last.substr(1), prefix};
  if (last == "angle" && words.size() > 1 && words[words.size() - 2] != "euler")
    return {"angle", joined(words, words.size() - 1)};
  if (one_of(last, {"button", "buttons", "pedal", "footpedal", "trigger", "switch", "btn"}))
    return {"buttons", ""};
  if (last == "rpm" || lower(name.unit) == "rpm" || lower(name.unit) == "1/min" ||
      name.unit == "rev/s" ||
      (words.size() > 1 && words[words.size() - 2] == "rotation" && last == "rate"))
    return {"rotation_rate", ""};
  if (last == "stalled") return {"stalled", ""};
  if (last == "torque") return {"torque", ""};
  for (const std::string& word : words)
    if (one_of(word, kTime)) return {"time", ""};
  if (one_of(last, {"secs", "seconds", "sec"})) return {"time", ""};
  return {};
}

// What belongs together: all of a set or none.
const std::vector<std::vector<std::string>>& sets() {
  static const std::vector<std::vector<std::string>> kSets = {
      {"x", "y", "z"},
      {"qx", "qy", "qz", "qw"},
      {"rx", "ry", "rz"},
      {"e1", "e2", "e3"},
      {"r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33"},
      {"axis_x", "axis_y", "axis_z", "angle"},
      {"fx", "fy", "fz"}};
  return kSets;
}

// The columns that may have a meaning: by prefix, then by key.
using Candidates = std::map<std::string, std::map<std::string, std::vector<std::size_t>>>;

// Of a set, the prefix under which it is complete; the one that names the bur or is `like` another
// if there are several.
std::optional<std::string> prefix_of(const Candidates& candidates,
                                     const std::vector<std::string>& set, const std::string& like,
                                     const std::string& path, const RecordedTable& table) {
  std::vector<std::string> complete;
  for (const auto& [prefix, keys] : candidates)
    if (std::all_of(set.begin(), set.end(),
                    [&, &k = keys](const std::string& key) { return k.count(key) > 0; }))
      complete.push_back(prefix);
  if (complete.empty()) return {};
  if (complete.size() == 1) return complete.front();
  if (one_of(like, complete)) return like;
  std::vector<std::string> of_bur;
  for (const std::string& prefix : complete) {
    const Words words = words_of(prefix);
    if (std::any_of(words.begin(), words.end(),
                    [](const std::string& w) { return one_of(w, kBur); }))
      of_bur.push_back(prefix);
  }
  if (of_bur.size() == 1) return of_bur.front();
  std::string names;
  for (const std::string& prefix : complete) {
    const std::size_t column = candidates.at(prefix).at(set.front()).front();
    names += (names.empty() ? "" : ", ") + ("'" + table.names[column] + "'");
  }
  throw InputError(path, "header", "several columns may be " + set.front() + ": " + names,
                   "say which: --columns " + set.front() + "=NAME,...");
}

void rename_numbered(Candidates& candidates, bool& scalar_first) {
  for (auto& [prefix, keys] : candidates) {
    const auto move = [&, &k = keys](const std::string& from, const std::string& to) {
      if (const auto found = k.find(from); found != k.end()) {
        k[to] = found->second;
        k.erase(from);
      }
    };
    if (keys.count("quaternion_0") && keys.count("qx")) {  // q0, qx, qy, qz: the scalar is q0
      move("quaternion_0", "qw");
    } else if (keys.count("quaternion_0") && keys.count("quaternion_3")) {
      move("quaternion_0", "qw");
      move("quaternion_1", "qx");
      move("quaternion_2", "qy");
      move("quaternion_3", "qz");
      scalar_first = true;
    }
    const int first = keys.count("matrix_00") ? 0 : 1;
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 3; ++column)
        move(fmt::format("matrix_{}{}", row + first, column + first),
             fmt::format("r{}{}", row + 1, column + 1));
  }
}

}  // namespace

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

const std::vector<std::string>& quantity_keys() {
  static const std::vector<std::string> kKeys = [] {
    std::vector<std::string> keys = {"time", "buttons", "rotation_rate", "torque", "stalled"};
    for (const auto& set : sets()) keys.insert(keys.end(), set.begin(), set.end());
    return keys;
  }();
  return kKeys;
}

bool ColumnRoles::has_all(const std::vector<std::string>& keys) const {
  return std::all_of(keys.begin(), keys.end(), [&](const std::string& key) { return has(key); });
}

namespace {

// The table that `toothprep export` writes has several poses; a path is the handle's.
bool set_own_export(const RecordedTable& table, ColumnRoles& roles) {
  const auto column = [&](const std::string& name) {
    return static_cast<std::size_t>(std::find(table.names.begin(), table.names.end(), name) -
                                    table.names.begin());
  };
  const std::size_t none = table.names.size();
  if (column("handle_x_mm") == none || column("bur_x_mm") == none || column("time_s") == none)
    return false;
  const auto set = [&](const std::string& key, const std::string& name, const std::string& unit) {
    if (column(name) != none) roles.of[key] = {column(name), unit};
  };
  set("time", "time_s", "s");
  for (const std::string axis : {"x", "y", "z"}) {
    set(axis, "handle_" + axis + "_mm", "mm");
    set("f" + axis, "force_measured_" + axis + "_N", "N");
  }
  for (const std::string part : {"qx", "qy", "qz", "qw"}) set(part, "handle_" + part, "");
  set("buttons", "handle_buttons", "");
  roles.notes.push_back("a trace of toothprep: the handle's motion");
  return true;
}

}  // namespace

ColumnRoles recognise_columns(const RecordedTable& table, const std::string& path) {
  ColumnRoles roles;
  if (set_own_export(table, roles)) return roles;
  Candidates candidates;
  std::vector<Name> names;
  std::vector<std::size_t> times;
  for (std::size_t c = 0; c < table.names.size(); ++c) {
    names.push_back(parse(table.names[c]));
    const Meaning meaning = meaning_of(names.back());
    if (meaning.key == "time")
      times.push_back(c);
    else if (!meaning.key.empty())
      candidates[meaning.prefix][meaning.key].push_back(c);
  }
  rename_numbered(candidates, roles.scalar_first);
  const auto put = [&](const std::string& key, std::size_t column) {
    roles.of[key] = {column, names[column].unit};
  };
  if (!times.empty()) {
    put("time", times.front());
    for (std::size_t i = 1; i < times.size(); ++i)
      roles.notes.push_back("column '" + table.names[times[i]] + "' is a second time and left out");
  }
  std::string like;
  for (const auto& set : sets()) {
    const auto prefix = prefix_of(candidates, set, like, path, table);
    if (!prefix) continue;
    if (set.front() == "x") like = *prefix;
    for (const std::string& key : set) {
      const auto& columns = candidates[*prefix][key];
      if (columns.size() > 1)
        throw InputError(path, "header",
                         "several columns may be " + key + ": '" + table.names[columns[0]] +
                             "', '" + table.names[columns[1]] + "'",
                         "say which: --columns " + key + "=NAME,...");
      put(key, columns.front());
    }
  }
  for (const std::string key : {"buttons", "rotation_rate", "torque", "stalled"})
    if (const auto found = candidates[""].find(key); found != candidates[""].end())
      put(key, found->second.front());
  return roles;
}

void set_columns(const std::string& text, const RecordedTable& table, ColumnRoles& roles) {
  const std::string option = "--columns";
  std::set<std::string> given;
  std::size_t start = 0;
  while (start <= text.size()) {
    const std::size_t end = std::min(text.find(',', start), text.size());
    const std::string piece = text.substr(start, end - start);
    start = end + 1;
    const std::size_t equals = piece.find('=');
    if (equals == std::string::npos)
      throw InputError(option, "'" + piece + "'", "is not KEY=COLUMN", "e.g. time=Time,x=PosX");
    const std::string key = piece.substr(0, equals), name = piece.substr(equals + 1);
    if (!one_of(key, quantity_keys()))
      throw InputError(option, "'" + key + "'", "is no quantity",
                       "did you mean '" + nearest_name(key, quantity_keys()) + "'?");
    if (!given.insert(key).second) throw InputError(option, "'" + key + "'", "stands twice");
    std::size_t column = table.names.size();
    for (std::size_t c = table.names.size(); c-- > 0;)
      if (table.names[c] == name || lower(table.names[c]) == lower(name)) column = c;
    std::size_t number = 0;
    const auto [stop, error] = std::from_chars(name.data(), name.data() + name.size(), number);
    if (column == table.names.size() && error == std::errc() && stop == name.data() + name.size() &&
        number >= 1 && number <= table.names.size())
      column = number - 1;
    if (column == table.names.size())
      throw InputError(option, "'" + name + "'", "is no column of the table",
                       "did you mean '" + nearest_name(name, table.names) + "'?");
    roles.of[key] = {column, parse(table.names[column]).unit};
  }
  for (const auto& set : sets()) {
    const auto named = std::count_if(set.begin(), set.end(),
                                     [&](const std::string& key) { return given.count(key) > 0; });
    if (named == 0 || named == static_cast<std::ptrdiff_t>(set.size())) continue;
    for (const std::string& key : set)
      if (!given.count(key))
        throw InputError(option, "'" + key + "'", "is missing beside '" + set.front() + "'",
                         "name all of them");
  }
  // A way to give the orientation replaces any other.
  const std::vector<std::string> ways = {"qx", "rx", "e1", "r11", "axis_x"};
  for (const std::string& way : ways)
    if (given.count(way))
      for (const auto& set : sets())
        if (one_of(set.front(), ways) && set.front() != way)
          for (const std::string& key : set) roles.of.erase(key);
  if (given.count("qx")) roles.scalar_first = false;
}

}  // namespace toothprep
