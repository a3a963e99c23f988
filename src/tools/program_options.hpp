#pragma once

#include <boost/program_options.hpp>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace vi_ekf_slam {

/// A command line that cannot be followed; what() says why.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Boost.Program_options as the programs here use it: --option value or --option=value, nothing abbreviated.
/// Words without an option are values of `positional`, at most one of them. Throws UsageError.
boost::program_options::variables_map parseOptions(int argc, const char* const* argv,
                                                   const boost::program_options::options_description& known,
                                                   const char* positional = nullptr);

/// The value of an option that is a whole number. Throws UsageError.
std::uint64_t wholeNumber(const std::string& option, const std::string& text, std::uint64_t least,
                          std::uint64_t most);

} // namespace vi_ekf_slam
