// toothprep help: what a command is for, and the manual for `man`. toothprep completion: for the shell.
#include <fstream>
#include <iostream>
#include <memory>

#include "command.h"
#include "command_tree.h"
#include "completion.h"
#include "man_page.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/outputs.h"
#include "wrong_usage.h"

namespace toothprep::app {
namespace {

struct HelpOptions {
  std::vector<std::string> command;
  std::string man_pages;
  bool force = false;
};

void print_help(const CLI::App& root, const std::vector<std::string>& path) {
  const CLI::App* command = &root;
  std::string name = "toothprep";
  for (const std::string& word : path) {
    const CLI::App* next = subcommand_of(*command, word);
    if (next == nullptr)
      throw CLI::ExtrasError(unknown_command(*command, word), CLI::ExitCodes::ExtrasError);
    command = next;
    name += " " + word;
  }
  std::cout << command->get_formatter()->make_help(command, name, CLI::AppFormatMode::Normal);
}

void write_pages(const CommandFacts& command, const CommandFacts& root, const std::string& folder) {
  const std::string file = folder + "/" + command.name("-") + ".1";
  std::ofstream out(file);
  out << man_page(command, root);
  if (!out.flush()) throw InputError(file, "", "cannot be written");
  for (const CommandFacts& sub : command.commands) write_pages(sub, root, folder);
}

void run(const CLI::App& root, const HelpOptions& o) {
  if (o.man_pages.empty()) return print_help(root, o.command);
  Outputs outputs(o.force);
  const std::string folder = outputs.folder(o.man_pages);
  outputs.begin();
  const CommandFacts facts = describe(root);
  write_pages(facts, facts, folder);
  outputs.publish();
}

}  // namespace

void add_help(CLI::App& app, const Common&) {
  auto* sub = app.add_subcommand("help", "What the program or a command is for, with its options");
  const auto o = std::make_shared<HelpOptions>();
  sub->add_option("command", o->command, "A command, such as replay, or specimen cavity");
  sub->add_option("--man-pages", o->man_pages, "Folder to make: the manual, for man")
      ->excludes("command");
  sub->add_flag("--force", o->force, "Replace an existing folder");
  sub->footer("Example: toothprep help replay");
  sub->callback([o, &app] { run(app, *o); });
}

void add_completion(CLI::App& app, const Common&) {
  auto* sub = app.add_subcommand(
      "completion", "A script with which a shell completes commands, options and values");
  const auto shell = std::make_shared<std::string>();
  sub->add_option("shell", *shell, "bash, zsh or fish")
      ->required()
      ->check(CLI::IsMember({"bash", "zsh", "fish"}));
  sub->footer(
      "An installed toothprep brings it along. For this shell alone, or a program that was only "
      "built:\n"
      "Example: source <(toothprep completion bash)");
  sub->callback([shell, &app] { std::cout << completion_script(*shell, describe(app)); });
}

}  // namespace toothprep::app
