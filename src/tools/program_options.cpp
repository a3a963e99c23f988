#include "program_options.hpp"

#include <cstdlib>
#include <vector>

namespace vi_ekf_slam {

namespace po = boost::program_options;

namespace {

constexpr char kSurplus[] = "surplus"; // words that belong to no option

/// The words behind the program's name, "--name=" as "--name" and an empty one, which Boost takes for nothing
/// but that.
std::vector<std::string> withEmptyValues(int argc, const char* const* argv) {
  std::vector<std::string> words;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const bool is_empty = word.rfind("--", 0) == 0 && word.find('=') == word.size() - 1;
    words.push_back(is_empty ? word.substr(0, word.size() - 1) : word);
    if (is_empty) words.emplace_back();
  }
  return words;
}

} // namespace

po::variables_map parseOptions(int argc, const char* const* argv, const po::options_description& known,
                               const char* positional) {
  po::positional_options_description words;
  if (positional != nullptr) words.add(positional, 1);
  words.add(kSurplus, -1);
  po::options_description all;
  all.add(known).add_options()(kSurplus, po::value<std::vector<std::string>>());
  constexpr int kStyle = po::command_line_style::unix_style & ~po::command_line_style::allow_guessing;
  po::variables_map values;
  try {
    po::store(po::command_line_parser(withEmptyValues(argc, argv))
                  .options(all)
                  .positional(words)
                  .style(kStyle)
                  .run(),
              values);
    if (values.count(kSurplus) > 0)
      throw UsageError("unknown argument '" + values[kSurplus].as<std::vector<std::string>>().front() + "'");
    po::notify(values);
  } catch (const po::error& e) {
    throw UsageError(e.what());
  }
  return values;
}

std::uint64_t wholeNumber(const std::string& option, const std::string& text, std::uint64_t least,
                          std::uint64_t most) {
  const bool digits =
      !text.empty() && text.size() < 19 && text.find_first_not_of("0123456789") == std::string::npos;
  const std::uint64_t value = digits ? std::strtoull(text.c_str(), nullptr, 10) : 0;
  if (!digits || value < least || value > most)
    throw UsageError(option + " is '" + text + "', allowed: a whole number from " + std::to_string(least) +
                     " to " + std::to_string(most));
  return value;
}

} // namespace vi_ekf_slam
