#include "wrong_usage.h"

#include <optional>

#include "command_tree.h"
#include "toothprep/step/core/nearest_name.h"

namespace toothprep::app {
namespace {

// The command that was named last, and those above it, outermost first.
std::vector<const CLI::App*> named_commands(const CLI::App& app) {
  std::vector<const CLI::App*> path = {&app};
  while (!path.back()->get_subcommands().empty())
    path.push_back(path.back()->get_subcommands().front());
  return path;
}

std::string spoken(const std::vector<const CLI::App*>& path) {
  std::string text = "toothprep";
  for (std::size_t n = 1; n < path.size(); ++n) text += " " + path[n]->get_name();
  return text;
}

// The name that was meant: the nearest, if it is near, or one that begins the same ("--spacing" for "--spacing-mm").
std::string meant(const std::string& name, const std::vector<std::string>& candidates) {
  std::vector<std::string> near;
  for (const std::string& candidate : candidates) {
    const bool begins = name.size() >= 3 && candidate.size() >= 3 &&
                        (candidate.starts_with(name) || name.starts_with(candidate));
    if (begins || edit_distance(name, candidate) <= std::max<std::size_t>(2, name.size() / 3))
      near.push_back(candidate);
  }
  return nearest_name(name, near);
}

std::string answer(const std::string& fault, const std::string& nearest, const std::string& help) {
  if (nearest.empty()) return fault + "; '" + help + "' lists them";
  return fault + "; did you mean '" + nearest + "'? ('" + help + "' lists them)";
}

void add_long_names(const CommandFacts& command, std::vector<std::string>& names) {
  for (const OptionFacts& option : command.options())
    for (const std::string& name : option.names)
      if (name.starts_with("--")) names.push_back(name.substr(2));
}

std::string unknown_option(const std::vector<const CLI::App*>& path, const std::string& word) {
  const std::string option = word.substr(0, word.find('='));
  std::vector<std::string> names;
  if (option.starts_with("--"))
    for (auto command = path.rbegin(); command != path.rend(); ++command)
      add_long_names(describe(**command), names);
  const std::string nearest = option.size() > 3 ? meant(option.substr(2), names) : "";
  std::string help = spoken(path);
  help.insert(std::string("toothprep").size(), " help");
  return answer(spoken(path) + ": no option '" + option + "'",
                nearest.empty() ? "" : "--" + nearest, help);
}

// The words that nothing took, in their order.
std::vector<std::string> left_over(const std::vector<const CLI::App*>& path) {
  std::vector<std::string> words;
  for (const CLI::App* command : path)
    for (const std::string& word : command->remaining())
      if (word != "--") words.push_back(word);
  return words;
}

bool wants_command(const CLI::App& app) {
  return app.get_require_subcommand_min() > 0 && app.get_subcommands().empty();
}

std::optional<std::string> unknown_word(const std::vector<const CLI::App*>& path) {
  for (const std::string& word : left_over(path)) {
    if (word.size() > 1 && word[0] == '-') return unknown_option(path, word);
    if (wants_command(*path.back())) return unknown_command(*path.back(), word);
  }
  return {};
}

}  // namespace

std::string unknown_command(const CLI::App& parent, const std::string& name) {
  std::vector<std::string> names;
  for (const CommandFacts& command : describe(parent).commands)
    names.push_back(command.path.back());
  const std::string above = parent.get_parent() == nullptr ? "" : " " + parent.get_name();
  return answer("toothprep" + above + ": no command '" + name + "'", meant(name, names),
                "toothprep help" + above);
}

bool names_unknown_command(const CLI::App& app) {
  const auto path = named_commands(app);
  if (!wants_command(*path.back())) return false;
  for (const std::string& word : left_over(path))
    if (!word.empty() && word[0] != '-') return true;
  return false;
}

std::string wrong_usage(const CLI::App& app, const CLI::ParseError& error) {
  const auto path = named_commands(app);
  const bool extra = dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr;
  if (extra && left_over(path).empty()) return std::string(error.what()) + "\n";  // of `help`
  if (extra || names_unknown_command(app) ||
      dynamic_cast<const CLI::RequiredError*>(&error) != nullptr)
    if (const auto unknown = unknown_word(path)) return *unknown + "\n";
  return std::string(error.what()) + "\nRun with --help for more information.\n";
}

}  // namespace toothprep::app
