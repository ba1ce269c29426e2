#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "toothprep/tools/io/csv_writer.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/plain_text.h"

namespace toothprep {
namespace {

TEST(PlainText, OnlyFiniteDecimalsAreNumbers) {
  EXPECT_EQ(decimal_number("1.25"), 1.25);
  EXPECT_EQ(decimal_number("-3e-4"), -3e-4);
  EXPECT_EQ(decimal_number("+2"), 2.0);
  EXPECT_EQ(decimal_number(".5"), 0.5);
  for (const char* text : {"", "+", "-", "+-1", "nan", "NaN", "inf", "-inf", "infinity", "1e400",
                           "-1e400", "0x10", "1,5", " 1", "1 ", "1mm", "--1"})
    EXPECT_EQ(decimal_number(text), std::nullopt) << text;
}

TEST(PlainText, TerminalsGetNoControlCharacters) {
  EXPECT_EQ(terminal_text("tooth \xc3\xa9\xe6\xad\xaf.vdb\n\t"),
            "tooth \xc3\xa9\xe6\xad\xaf.vdb\n\t");
  EXPECT_EQ(terminal_text("\x1b[31mred\x07"), "\\x1b[31mred\\x07");
  EXPECT_EQ(terminal_text("a\rb\x7f"), "a\\x0db\\x7f");
  EXPECT_EQ(terminal_text("\xc2\x9b"
                          "31m"),
            "\\xc2\\x9b31m");  // CSI as one character
  EXPECT_EQ(terminal_text("\xe2\x80\xae"
                          "x"),
            "\\xe2\\x80\\xaex");                    // right-to-left override
  EXPECT_EQ(terminal_text("caf\xe9"), "caf\\xe9");  // Latin-1
  EXPECT_EQ(terminal_text("\xc0\xaf\xed\xa0\x80\xf4\x90\x80\x80\xe6\xad"),
            "\\xc0\\xaf\\xed\\xa0\\x80\\xf4\\x90\\x80\\x80\\xe6\\xad");
  EXPECT_EQ(terminal_text(std::string("a\0b", 3)), "a\\x00b");
}

TEST(PlainText, CellsOfTextAreNoFormulas) {
  EXPECT_EQ(csv_cell("enamel"), "enamel");
  EXPECT_EQ(csv_cell("a,b"), "\"a,b\"");
  EXPECT_EQ(csv_cell("say \"x\""), "\"say \"\"x\"\"\"");
  EXPECT_EQ(csv_cell("=1+1"), "'=1+1");
  EXPECT_EQ(csv_cell("-2+3,4"), "\"'-2+3,4\"");
  EXPECT_EQ(csv_cell("+x"), "'+x");
  EXPECT_EQ(csv_cell("@SUM(A1)"), "'@SUM(A1)");
  EXPECT_EQ(csv_cell("\t=1"), "'\t=1");
  EXPECT_EQ(csv_cell(""), "");
}

TEST(PlainText, TablesQuoteTextAndLeaveNumbersAlone) {
  const std::string path =
      (std::filesystem::temp_directory_path() / ("cells" + std::to_string(getpid()))).string();
  CsvWriter csv(path);
  csv.text("=a");
  csv.text("b,c");
  csv.number(-1.5);
  csv.end_row();
  csv.close();
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  std::filesystem::remove(path);
  EXPECT_EQ(text.str(), "'=a,\"b,c\",-1.5\n");
}

TEST(PlainText, JsonIsValidWhateverANameHolds) {
  const nlohmann::ordered_json named = {{"file", "caf\xe9\x1b.vdb"}, {"caf\xe9", 1}};
  const auto read = nlohmann::ordered_json::parse(json_text(named));
  EXPECT_EQ(read["file"], "caf\xef\xbf\xbd\x1b.vdb");
  EXPECT_EQ(read["caf\xef\xbf\xbd"], 1);
}

}  // namespace
}  // namespace toothprep
