# All controllers of this folder as one library, controllers, which brings its include folder, and their self-tests.
# Made by barbalat, and made anew with each export into this folder.
cmake_minimum_required(VERSION 3.10)
project(controllers C)

set(CONTROLLERS ${names})

add_library(controllers STATIC)
target_include_directories(controllers PUBLIC $${CMAKE_CURRENT_LIST_DIR})
target_compile_options(controllers PRIVATE -std=c99 -ffp-contract=off)
target_link_libraries(controllers PUBLIC m)
foreach(name IN LISTS CONTROLLERS)
    target_sources(controllers PRIVATE $${CMAKE_CURRENT_LIST_DIR}/$${name}_controller.c)
endforeach()

if(CMAKE_SOURCE_DIR STREQUAL CMAKE_CURRENT_SOURCE_DIR) # not inside of another project
    enable_testing()
    foreach(name IN LISTS CONTROLLERS)
        add_executable($${name}_selftest $${name}_selftest.c)
        target_compile_options($${name}_selftest PRIVATE -std=c99 -ffp-contract=off)
        target_link_libraries($${name}_selftest PRIVATE controllers)
        add_test(NAME $${name} COMMAND $${name}_selftest)
    endforeach()
endif()
