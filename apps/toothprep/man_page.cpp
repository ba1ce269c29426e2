#include "man_page.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <sstream>

#include "toothprep/version.h"

namespace toothprep::app {
namespace {

// The characters of UTF-8 text; the program's own text is valid.
std::vector<char32_t> characters(const std::string& text) {
  std::vector<char32_t> all;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x80)
      all.push_back(byte);
    else if (byte >= 0xC0)
      all.push_back(byte >= 0xF0 ? byte & 0x07 : byte >= 0xE0 ? byte & 0x0F : byte & 0x1F);
    else if (!all.empty())
      all.back() = all.back() << 6 | (byte & 0x3F);
  }
  return all;
}

// Text as roff prints it: nothing in it is a request.
std::string roff(const std::string& text) {
  std::string out;
  bool line_begins = true;
  for (const char32_t c : characters(text)) {
    if (line_begins && (c == '.' || c == '\'')) out += "\\&";
    if (c == '\\')
      out += "\\e";
    else if (c == '-')
      out += "\\-";
    else if (c == '\'')
      out += "\\(aq";
    else if (c == '^')
      out += "\\(ha";
    else if (c == '~')
      out += "\\(ti";
    else if (c == '`')
      out += "\\(ga";
    else if (c < 0x80)
      out += static_cast<char>(c);
    else
      out += fmt::format("\\[u{:04X}]", static_cast<std::uint32_t>(c));
    line_begins = c == '\n';
  }
  return out;
}

std::string bold(const std::string& text) { return "\\fB" + roff(text) + "\\fR"; }
std::string italic(const std::string& text) { return "\\fI" + roff(text) + "\\fR"; }

std::string upper(std::string text) {
  for (char& c : text) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return text;
}

// "FLOAT,FLOAT,FLOAT", "a|b", "TEXT ...".
std::string value_of(const OptionFacts& option) {
  if (!option.choices.empty()) return fmt::format("{}", fmt::join(option.choices, "|"));
  std::string value = option.value;
  for (int n = 1; n < option.count; ++n) value += "," + option.value;
  return option.count < 0 ? value + " ..." : value;
}

std::string option_heading(const OptionFacts& option) {
  if (!option.positional.empty()) return italic(option.positional);
  std::string heading;
  for (const std::string& name : option.names)
    heading += (heading.empty() ? "" : ", ") + bold(name);
  return option.is_flag() ? heading : heading + " " + italic(value_of(option));
}

std::string option_text(const OptionFacts& option) {
  std::vector<std::string> facts;
  if (option.required) facts.push_back("required");
  if (!option.range.empty()) facts.push_back(option.range);
  if (!option.preset.empty()) facts.push_back("default " + option.preset);
  const std::string more = facts.empty() ? "" : fmt::format(" [{}]", fmt::join(facts, "; "));
  return roff(option.description + more);
}

void write_options(const CommandFacts& command, std::ostream& out) {
  out << ".SH OPTIONS\n";
  for (const OptionSection& section : command.sections) {
    if (section.options.empty()) continue;
    if (!section.title.empty()) out << ".SS " << roff(section.title) << "\n";
    for (const OptionFacts& option : section.options)
      out << ".TP\n" << option_heading(option) << "\n" << option_text(option) << "\n";
  }
}

void write_synopsis(const CommandFacts& command, std::ostream& out) {
  out << ".SH SYNOPSIS\n" << bold(command.name()) << " [" << italic("OPTIONS") << "]";
  for (const OptionFacts& option : command.options()) {
    if (option.positional.empty()) continue;
    const std::string name =
        italic(option.positional) + (option.count < 0 ? std::string(" ...") : std::string());
    out << " " << (option.required ? name : "[" + name + "]");
  }
  if (!command.commands.empty()) out << " " << italic("COMMAND");
  out << "\n";
}

void write_commands(const CommandFacts& command, std::ostream& out) {
  if (command.commands.empty()) return;
  out << ".SH COMMANDS\n";
  for (const CommandFacts& sub : command.commands)
    out << ".TP\n" << bold(sub.name("-")) << "(1)\n" << roff(sub.description) << "\n";
}

void write_verbatim(const std::string& title, const std::string& text, std::ostream& out) {
  if (text.empty()) return;
  out << ".SH " << title << "\n.nf\n" << roff(text) << "\n.fi\n";
}

void write_environment(std::ostream& out) {
  out << ".SH EXIT STATUS\n"
         "0: done. 1: failed, with one line on stderr. 2: wrong usage.\n"
         ".SH ENVIRONMENT\n"
         ".TP\n\\fBTOOTHPREP_DATA\\fR\n"
         "Folder of burs, parameters, rubrics and pages, in place of the installed one.\n"
         ".TP\n\\fBTOOTHPREP_LIBHD\\fR\n"
         "Library of the haptic device's vendor, in place of libHD.so.\n";
}

void write_see_also(const CommandFacts& command, const CommandFacts& root, std::ostream& out) {
  std::vector<std::string> pages;
  if (command.path.size() > 1) {
    pages.push_back("toothprep");
    if (command.path.size() > 2) pages.push_back("toothprep-" + command.path[1]);
  } else {
    for (const CommandFacts& sub : root.commands) pages.push_back(sub.name("-"));
  }
  out << ".SH SEE ALSO\n";
  for (std::size_t n = 0; n < pages.size(); ++n)
    out << bold(pages[n]) << "(1)" << (n + 1 < pages.size() ? ",\n" : "\n");
}

}  // namespace

std::string man_page(const CommandFacts& command, const CommandFacts& root) {
  const bool is_root = command.path.size() == 1;
  std::string description = command.description, examples = command.footer;
  if (is_root) {  // "toothprep: what it is. Some sentences.\nExample: ..."
    description.erase(0, description.find(": ") + 2);
    const std::size_t example = std::min(description.find("\nExample"), description.size());
    examples = description.substr(example + (example < description.size() ? 1 : 0)) + examples;
    description.resize(example);
  }
  const std::string first = description.substr(0, description.find_first_of(".:\n"));
  std::ostringstream out;
  out << ".TH " << upper(command.name("-")) << " 1 \"\" \"toothprep " << kVersion
      << "\" \"User Commands\"\n"
      << ".SH NAME\n"
      << roff(command.name("-")) << " \\- " << roff(first) << "\n";
  write_synopsis(command, out);
  out << ".SH DESCRIPTION\n" << roff(description) << "\n";
  write_options(command, out);
  if (!is_root) out << ".PP\nThe options of " << bold("toothprep") << "(1) hold too.\n";
  write_commands(command, out);
  write_verbatim("NOTES AND EXAMPLES", examples, out);
  write_environment(out);
  write_see_also(command, root, out);
  return out.str();
}

}  // namespace toothprep::app
