# SPDX-License-Identifier: BSD-3-Clause
# Install the built library under a fresh prefix, move the prefix, and build and run the consumers against it.
cmake_minimum_required(VERSION 3.25)

function(run)
   execute_process(COMMAND ${ARGN} COMMAND_ECHO STDOUT COMMAND_ERROR_IS_FATAL ANY)
endfunction()

file(REMOVE_RECURSE ${WORK})
file(MAKE_DIRECTORY ${WORK})
run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/first)
file(RENAME ${WORK}/first ${WORK}/prefix)  # the prefix must not be written into installed files

# find_package
run(${CMAKE_COMMAND} -S ${CONSUMER} -B ${WORK}/build -D CMAKE_PREFIX_PATH=${WORK}/prefix
   -D CMAKE_Fortran_COMPILER=${FORTRAN} -D CMAKE_C_COMPILER=${CC} -D WANTED=${VERSION} -G ${GENERATOR})
run(${CMAKE_COMMAND} --build ${WORK}/build)
run(${WORK}/build/consumer_fortran)
run(${WORK}/build/consumer_c)
if(CXX)
   run(${WORK}/build/consumer_cpp)
endif()

# embedded, in a Debug build: users must not inherit the library's strict flags
run(${CMAKE_COMMAND} -S ${CONSUMER}/../embedding -B ${WORK}/embedding -D CMAKE_BUILD_TYPE=Debug
   -D CMAKE_EXPORT_COMPILE_COMMANDS=ON -D CMAKE_Fortran_COMPILER=${FORTRAN} -D CMAKE_C_COMPILER=${CC} -G ${GENERATOR})
file(READ ${WORK}/embedding/compile_commands.json commands)
if(NOT commands MATCHES "full[.]f90" OR commands MATCHES "-Werror")
   message(FATAL_ERROR "a project that embeds symsde in a Debug build compiles it with -Werror, or not at all")
endif()

# pkg-config
if(PKG_CONFIG)
   set(ENV{PKG_CONFIG_PATH} ${WORK}/prefix/${LIBDIR}/pkgconfig)
   set(ENV{LD_LIBRARY_PATH} ${WORK}/prefix/${LIBDIR})
   execute_process(COMMAND ${PKG_CONFIG} --cflags --libs "symsde = ${VERSION}"
      OUTPUT_VARIABLE flags OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
   separate_arguments(flags UNIX_COMMAND "${flags}")
   run(${FORTRAN} ${CONSUMER}/consumer.f90 -o ${WORK}/pkg_fortran ${flags})
   run(${CC} ${CONSUMER}/consumer.c -o ${WORK}/pkg_c ${flags})
   run(${WORK}/pkg_fortran)
   run(${WORK}/pkg_c)
   if(CXX)
      run(${CXX} -std=c++17 ${CONSUMER}/consumer.cpp -o ${WORK}/pkg_cpp ${flags})
      run(${WORK}/pkg_cpp)
   endif()
endif()

# Meson, by pkg-config
if(MESON)
   set(ENV{FC} ${FORTRAN})
   set(ENV{CC} ${CC})
   run(${MESON} setup ${WORK}/meson ${CONSUMER})
   run(${MESON} compile -C ${WORK}/meson)
   run(${WORK}/meson/consumer_fortran)
   run(${WORK}/meson/consumer_c)
endif()
