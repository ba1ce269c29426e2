#include "completion.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <functional>
#include <sstream>

namespace toothprep::app {
namespace {

// The command and all below it, `visit`ed with it.
void for_each(const CommandFacts& command, const std::function<void(const CommandFacts&)>& visit) {
  visit(command);
  for (const CommandFacts& sub : command.commands) for_each(sub, visit);
}

// "specimen cavity": without the program's name.
std::string below(const CommandFacts& command) {
  return fmt::format("{}", fmt::join(command.path.begin() + 1, command.path.end(), " "));
}

std::vector<std::string> names_of(const std::vector<CommandFacts>& commands) {
  std::vector<std::string> names;
  names.reserve(commands.size());
  for (const CommandFacts& command : commands) names.push_back(command.path.back());
  return names;
}

std::vector<std::string> names_of(const std::vector<OptionFacts>& options) {
  std::vector<std::string> names;
  for (const OptionFacts& option : options)
    names.insert(names.end(), option.names.begin(), option.names.end());
  return names;
}

// The values of the command's positional, if they are words.
std::vector<std::string> positional_choices(const CommandFacts& command, const CommandFacts& root) {
  if (below(command) == "help") return names_of(root.commands);
  for (const OptionFacts& option : command.options())
    if (!option.positional.empty()) return option.choices;
  return {};
}

std::string joined(const std::vector<std::string>& words, const char* between) {
  return fmt::format("{}", fmt::join(words, between));
}

// In single quotes, for any of the three.
std::string quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text)
    if (c == '\'')
      out += "'\\''";
    else if (c == '\n')
      out += ' ';
    else
      out += c;
  return out + "'";
}

// ---- bash. Four tables in functions; the rest is the same whatever the commands are. An option's
// values come first: "replay --drive" has words, "replay --threads" a number, others are files.

constexpr const char* kBashBegin =
    R"(# bash completion for toothprep; made by: toothprep completion bash
_toothprep_commands() {
  case "$1" in
)";
constexpr const char* kBashEnd = R"(
_toothprep() {
  local cur=${COMP_WORDS[COMP_CWORD]} before=$((COMP_CWORD - 1)) command= word words
  COMPREPLY=()
  # --option=VALUE comes as three words.
  [[ $cur == = ]] && cur=
  [[ ${COMP_WORDS[before]} == = ]] && before=$((before - 1))
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do
    if [[ " $(_toothprep_commands "$command") " == *" $word "* ]]; then
      command=${command:+$command }$word
    fi
  done
  words=$(_toothprep_values "$command" "${COMP_WORDS[before]}")
  if [[ $words == number ]]; then
    return
  elif [[ -z $words && $cur == -* ]]; then
    words=$(_toothprep_options "$command")
  elif [[ -z $words ]]; then
    words=$(_toothprep_commands "$command")
    [[ -n $words ]] || words=$(_toothprep_words "$command")
  fi
  if [[ -n $words && $words != file ]]; then
    COMPREPLY=($(compgen -W "$words" -- "$cur"))
  else
    compopt -o filenames 2>/dev/null
    mapfile -t COMPREPLY < <(compgen -f -- "$cur")
  fi
}
complete -F _toothprep toothprep
)";

// A line of a `case`: what is printed for `pattern`. Nothing for nothing.
std::string bash_case(const std::string& pattern, const std::string& words) {
  return words.empty() ? "" : "    " + pattern + ") echo " + quoted(words) + " ;;\n";
}

std::string bash_values(const CommandFacts& command) {
  std::string out;
  for (const OptionFacts& option : command.options()) {
    if (option.is_flag() || !option.positional.empty()) continue;
    std::vector<std::string> patterns;
    for (const std::string& name : option.names)
      patterns.push_back(command.path.size() == 1 ? "*" + quoted(" " + name)
                                                  : quoted(below(command) + " " + name));
    const std::string words = !option.choices.empty() ? joined(option.choices, " ")
                              : option.is_number()    ? "number"
                                                      : "file";
    out += bash_case(joined(patterns, "|"), words);
  }
  return out;
}

std::string bash_script(const CommandFacts& root) {
  std::string commands, options, values, words;
  const std::string common = joined(names_of(common_options(root)), " ");
  for_each(root, [&](const CommandFacts& command) {
    const std::string pattern = quoted(below(command));
    commands += bash_case(pattern, joined(names_of(command.commands), " "));
    const std::string own = joined(names_of(command.options()), " ");
    options += bash_case(pattern, &command == &root ? own : own + " " + common);
    values += bash_values(command);
    words += bash_case(pattern, joined(positional_choices(command, root), " "));
  });
  // The end of one table and the beginning of the next.
  const auto next = [](const char* name, const char* subject) {
    return fmt::format("  esac\n}}\n_toothprep_{}() {{\n  case \"{}\" in\n", name, subject);
  };
  return kBashBegin + commands + next("options", "$1") + options + next("values", "$1 $2") +
         values + next("words", "$1") + words + "  esac\n}" + kBashEnd;
}

// ---- zsh: a function for each command.

std::string zsh_function(const CommandFacts& command) { return "_" + joined(command.path, "_"); }

// Text inside of an argument of _arguments.
std::string zsh_text(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '[' || c == ']' || c == ':' || c == '\\') out += '\\';
    out += c;
  }
  return out;
}

std::string zsh_action(const std::vector<std::string>& choices, bool number) {
  if (!choices.empty()) return "(" + joined(choices, " ") + ")";
  return number ? " " : "_files";
}

std::string zsh_command(const CommandFacts& command, const CommandFacts& root) {
  std::ostringstream out;
  out << zsh_function(command) << "() {\n  local -a arguments=(\n";
  std::vector<OptionFacts> options = command.options();
  if (&command != &root)
    for (const OptionFacts& option : common_options(root)) options.push_back(option);
  for (const OptionFacts& option : options)
    for (const std::string& name : option.names)
      out << "    "
          << quoted("*" + name +
                    (option.is_flag()         ? ""
                     : name.starts_with("--") ? "="
                                              : "+") +
                    "[" + zsh_text(option.description) + "]" +
                    (option.is_flag() ? ""
                                      : ":value:" + zsh_action(option.choices, option.is_number())))
          << "\n";
  if (command.commands.empty()) {
    out << "    " << quoted("*:argument:" + zsh_action(positional_choices(command, root), false))
        << "\n  )\n  _arguments -s : $arguments\n}\n";
    return out.str();
  }
  out << "  )\n  local state line context\n  typeset -A opt_args\n"
         "  _arguments -C -s : $arguments '1:command:->command' '*::argument:->argument'\n"
         "  case $state in\n  command)\n    local -a commands=(\n";
  for (const CommandFacts& sub : command.commands)
    out << "      " << quoted(sub.path.back() + ":" + zsh_text(sub.description)) << "\n";
  out << "    )\n    _describe command commands ;;\n  argument)\n    case $line[1] in\n";
  for (const CommandFacts& sub : command.commands)
    out << "    " << sub.path.back() << ") " << zsh_function(sub) << " ;;\n";
  out << "    esac ;;\n  esac\n}\n";
  return out.str();
}

std::string zsh_script(const CommandFacts& root) {
  std::string out = "#compdef toothprep\n# made by: toothprep completion zsh\n";
  for_each(root, [&](const CommandFacts& command) { out += zsh_command(command, root); });
  // In a file on fpath the function is called by its name; sourced, it is announced.
  return out +
         "if [ \"$funcstack[1]\" = _toothprep ]; then\n  _toothprep \"$@\"\nelse\n  compdef "
         "_toothprep toothprep\nfi\n";
}

// ---- fish: a line for each command and option.

std::string fish_condition(const CommandFacts& command) {
  if (command.path.size() == 1) return {};
  std::string condition = "__fish_seen_subcommand_from " + command.path[1];
  for (std::size_t n = 2; n < command.path.size(); ++n)
    condition += "; and __fish_seen_subcommand_from " + command.path[n];
  return condition;
}

std::string fish_line(const std::string& condition, const std::string& what) {
  return "complete -c toothprep" + (condition.empty() ? "" : " -n " + quoted(condition)) + " " +
         what + "\n";
}

std::string fish_option(const OptionFacts& option) {
  std::string what;
  for (const std::string& name : option.names)
    what += name.starts_with("--") ? "-l " + name.substr(2) + " " : "-s " + name.substr(1) + " ";
  if (!option.choices.empty())
    what += "-x -a " + quoted(joined(option.choices, " ")) + " ";
  else if (!option.is_flag())
    what += option.is_number() ? "-x " : "-r -F ";
  return what + "-d " + quoted(option.description);
}

std::string fish_script(const CommandFacts& root) {
  std::string out = "# made by: toothprep completion fish\n";
  for_each(root, [&](const CommandFacts& command) {
    const std::string condition = fish_condition(command);
    const std::string names = joined(names_of(command.commands), " ");
    const std::string still = condition.empty()
                                  ? "not __fish_seen_subcommand_from " + names
                                  : condition + "; and not __fish_seen_subcommand_from " + names;
    for (const CommandFacts& sub : command.commands)
      out += fish_line(still, "-f -a " + sub.path.back() + " -d " + quoted(sub.description));
    const std::string words = joined(positional_choices(command, root), " ");
    if (!words.empty()) out += fish_line(condition, "-f -a " + quoted(words));
    for (const OptionFacts& option : command.options())
      if (option.positional.empty()) out += fish_line(condition, fish_option(option));
  });
  return out;
}

}  // namespace

std::string completion_script(const std::string& shell, const CommandFacts& root) {
  return shell == "bash"  ? bash_script(root)
         : shell == "zsh" ? zsh_script(root)
                          : fish_script(root);
}

}  // namespace toothprep::app
