#include "command_tree.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace toothprep::app {
namespace {

std::vector<const CLI::App*> children(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App*) { return true; });
}

// What stands behind the type's name, ":{a,b}", ":INT in [0 - 1024]" or ":POSITIVE".
void read_limits(const std::string& text, OptionFacts& facts) {
  const std::size_t open = text.find('{'), close = text.rfind('}');
  const std::size_t low = text.find("in ["), dash = text.find(" - ", low), high = text.rfind(']');
  if (open != std::string::npos && close != std::string::npos)
    facts.choices = CLI::detail::split(text.substr(open + 1, close - open - 1), ',');
  else if (low != std::string::npos && dash != std::string::npos && high != std::string::npos)
    facts.range =
        text.substr(low + 4, dash - low - 4) + " to " + text.substr(dash + 3, high - dash - 3);
  else
    facts.range = CLI::detail::to_lower(text);
}

OptionFacts facts_of(const CLI::Option& option) {
  OptionFacts facts;
  for (const std::string& name : option.get_snames()) facts.names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) facts.names.push_back("--" + name);
  if (facts.names.empty()) facts.positional = option.get_name(true);
  facts.description = option.get_description();
  facts.required = option.get_required();
  if (option.get_items_expected_max() == 0) return facts;  // a flag
  const std::string type = option.get_type_name();
  const std::size_t colon = type.find(':');
  facts.value = type.substr(0, colon);
  if (colon != std::string::npos) read_limits(type.substr(colon + 1), facts);
  facts.preset = option.get_default_str();
  const int least = option.get_items_expected_min(), most = option.get_items_expected_max();
  facts.count = most >= CLI::detail::expected_max_vector_size ? -1 : std::max(least, 1);
  return facts;
}

// A group of options has a help flag of its own, which does nothing.
void add_options(const CLI::App& app, OptionSection& section) {
  const bool is_group = app.get_parent() != nullptr && app.get_name().empty();
  for (const CLI::Option* option : app.get_options())
    if (!option->get_group().empty() && !(is_group && option == app.get_help_ptr()))
      section.options.push_back(facts_of(*option));
}

CommandFacts describe(const CLI::App& app, std::vector<std::string> path) {
  CommandFacts facts;
  facts.path = path;
  facts.description = app.get_description();
  facts.footer = app.get_footer();
  facts.sections.emplace_back();
  add_options(app, facts.sections.front());
  for (const CLI::App* child : children(app)) {
    if (child->get_name().empty()) {  // a group of options
      facts.sections.push_back({child->get_group(), {}});
      add_options(*child, facts.sections.back());
    } else if (!child->get_group().empty()) {
      path.push_back(child->get_name());
      facts.commands.push_back(describe(*child, path));
      path.pop_back();
    }
  }
  return facts;
}

}  // namespace

bool OptionFacts::is_number() const {
  return value.find("INT") != std::string::npos || value.find("FLOAT") != std::string::npos;
}

std::string CommandFacts::name(const std::string& between) const {
  return fmt::format("{}", fmt::join(path, between));
}

std::vector<OptionFacts> CommandFacts::options() const {
  std::vector<OptionFacts> all;
  for (const OptionSection& section : sections)
    all.insert(all.end(), section.options.begin(), section.options.end());
  return all;
}

std::vector<OptionFacts> common_options(const CommandFacts& root) {
  std::vector<OptionFacts> common;
  for (const OptionFacts& option : root.options())
    if (option.names.back() != "--help" && option.names.back() != "--version")
      common.push_back(option);
  return common;
}

CommandFacts describe(const CLI::App& app) { return describe(app, {"toothprep"}); }

const CLI::App* subcommand_of(const CLI::App& app, const std::string& name) {
  for (const CLI::App* child : children(app))
    if (!name.empty() && child->get_name() == name) return child;
  return nullptr;
}

}  // namespace toothprep::app
