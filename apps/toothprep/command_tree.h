// What the command line is made of, as plain values: the manual, the completion and the answers to wrong usage
// are made of it.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace toothprep::app {

struct OptionFacts {
  std::vector<std::string> names;    // "-o", "--output"; none of a positional
  std::string positional;            // its name
  std::string value;                 // "TEXT", "FLOAT"; empty: a flag
  std::vector<std::string> choices;  // the only values it takes
  std::string range;                 // "0 to 1024", "positive"; empty: any
  std::string preset;                // its default
  std::string description;
  int count = 1;  // of values; -1: any number
  bool required = false;

  bool is_flag() const { return value.empty(); }
  bool is_number() const;
};

struct OptionSection {
  std::string title;  // empty: the first
  std::vector<OptionFacts> options;
};

struct CommandFacts {
  std::vector<std::string> path;  // "toothprep", "specimen", "cavity"
  std::string description, footer;
  std::vector<OptionSection> sections;
  std::vector<CommandFacts> commands;

  std::string name(const std::string& between = " ") const;  // "toothprep specimen cavity"
  std::vector<OptionFacts> options() const;                  // of all sections, positionals too
};

CommandFacts describe(const CLI::App& app);

// Those of the program's options that every command takes.
std::vector<OptionFacts> common_options(const CommandFacts& root);

// The subcommand of that name; null if there is none.
const CLI::App* subcommand_of(const CLI::App& app, const std::string& name);

}  // namespace toothprep::app
