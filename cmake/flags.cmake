# SPDX-License-Identifier: BSD-3-Clause
# Compile flags, in one place, on one interface target. -ffast-math is never used: the library promises
# bits, tests for NaN and infinity, and compensated sums, and -ffast-math breaks all three. Only SYMSDE_FLAGS=dev has
# -Werror: a Debug build of a project that embeds this one does not.
set(_sets dev release native sanitize sanitize-threads coverage)
set(SYMSDE_FLAGS release CACHE STRING "Set of compile flags: ${_sets}")
set_property(CACHE SYMSDE_FLAGS PROPERTY STRINGS ${_sets})

# One rule for all libraries that users build: a product and a sum are one operation (contraction) if the processor has
# it, so that builds for one machine, for x86-64-v3 and v4, and wheels compute the same bits. All sums contract alike:
# tuning for some processors would not contract sums in registers, and a single path would have other bits than a path
# in a block. With SYMSDE_FP_CONTRACT=off products are rounded everywhere, so that older processors and aarch64 agree,
# too.
set(SYMSDE_FP_CONTRACT fast CACHE STRING "Whether a product and a sum are one operation: fast, off")
set(_release -O3 -fno-trapping-math -fno-math-errno -ffp-contract=${SYMSDE_FP_CONTRACT})
if(CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|amd64|AMD64)$")
   list(APPEND _release --param=avoid-fma-max-bits=0)
endif()
set(_fortran_warnings
   -std=f2018 -fimplicit-none -Wall -Wextra -Wimplicit-interface -Wimplicit-procedure
   -Wno-unused-dummy-argument  # a kernel's interface is common to models that need less of it
   -Wcharacter-truncation -Warray-temporaries -Werror=trampolines)
set(_c_warnings -std=c11 -Wall -Wextra -Wpedantic -Wstrict-prototypes -Wmissing-prototypes)

if(SYMSDE_FLAGS STREQUAL "release")
   set(_common ${_release})
elseif(SYMSDE_FLAGS STREQUAL "native")
   set(_common ${_release} -march=native)
elseif(SYMSDE_FLAGS STREQUAL "dev")
   set(SYMSDE_CONTRACTS ON)  # executes src/base/contracts.f90
   set(_common -Og -g -Werror)
   set(_fortran ${_fortran_warnings} -fcheck=all -finit-real=snan -fbacktrace)
   set(_c ${_c_warnings})
elseif(SYMSDE_FLAGS STREQUAL "sanitize")
   set(SYMSDE_CONTRACTS ON)
   set(SYMSDE_SANITIZERS -fsanitize=address,undefined)
   # reports show line numbers, for which -g1 is enough; all of -g took a quarter of the time
   set(_common -O1 -g1 -fno-omit-frame-pointer ${SYMSDE_SANITIZERS} -fno-sanitize-recover=undefined)
   # passing on an absent optional array counts as a load of a null pointer, which is not an error
   set(_fortran -fcheck=all -fbacktrace -fno-sanitize=null)
elseif(SYMSDE_FLAGS STREQUAL "sanitize-threads")
   # for programs with threads of their own: this sanitizer does not see how OpenMP's threads synchronise
   set(SYMSDE_SANITIZERS -fsanitize=thread)
   set(_common -O1 -g1 -fno-omit-frame-pointer ${SYMSDE_SANITIZERS})
elseif(SYMSDE_FLAGS STREQUAL "coverage")
   # lines are counted, so -O1 merges few of them; threads count at the same time
   set(_common -O1 -g --coverage -fprofile-update=atomic)
   set(_link --coverage)
else()
   list(JOIN _sets ", " _sets)
   message(FATAL_ERROR "SYMSDE_FLAGS is '${SYMSDE_FLAGS}'; allowed are ${_sets}.")
endif()

if(NOT CMAKE_Fortran_COMPILER_ID STREQUAL "GNU" OR CMAKE_Fortran_COMPILER_VERSION VERSION_LESS 12)
   message(WARNING "symsde is tested with gfortran 12 and later; "
      "this is ${CMAKE_Fortran_COMPILER_ID} ${CMAKE_Fortran_COMPILER_VERSION}.")
endif()

# Compilers other than gfortran know few of these flags.
set(_known ${_common})
list(FILTER _known INCLUDE REGEX "^-(O[0-3]|g|march=.*|ffp-contract=.*)$")

add_library(symsde_flags INTERFACE)
target_compile_options(symsde_flags INTERFACE
   $<$<COMPILE_LANG_AND_ID:Fortran,GNU>:${_common};${_fortran}>
   $<$<AND:$<COMPILE_LANGUAGE:Fortran>,$<NOT:$<Fortran_COMPILER_ID:GNU>>>:${_known}>
   $<$<COMPILE_LANGUAGE:C>:${_common};${_c}>)
# The stack of the library is marked as not executable.
target_link_options(symsde_flags INTERFACE LINKER:-z,noexecstack ${SYMSDE_SANITIZERS} ${_link})
