/* SPDX-License-Identifier: MIT */
/*
 * cxx_memory.cpp - what a controller in C++ needs of the language's library, for daemons. The
 * library's own brings exceptions and stdio along: 130 kB for ARMv5. Weak: a controller may
 * have its own. Out of memory, or out of an array's range, ends the process, and the guard stops
 * the wheels.
 */
#include <cstdlib>
#include <new>

#include <unistd.h>

namespace {

[[noreturn]] void give_up(void)
{
    static const char words[] = "vsensed: the controller's C++ library gave up: no memory left, or"
                                " an index out of range\n";

    (void)!write(STDERR_FILENO, words, sizeof words - 1);
    std::abort();
}

}  // namespace

__attribute__((weak)) void *operator new(std::size_t size)
{
    void *memory = std::malloc(size > 0 ? size : 1);

    if (memory == nullptr)
        give_up();
    return memory;
}

__attribute__((weak)) void operator delete(void *memory) noexcept
{
    std::free(memory);
}

__attribute__((weak)) void operator delete(void *memory, std::size_t) noexcept
{
    std::free(memory);
}

/* A call of a function that its class only declares. */
extern "C" __attribute__((weak)) void __cxa_pure_virtual(void)
{
    give_up();
}

#ifdef _LIBCPP_VERSION /* LLVM's library, which documents that this may be replaced */
#include <__verbose_abort>

__attribute__((weak)) void std::__libcpp_verbose_abort(const char *, ...)
    _LIBCPP_VERBOSE_ABORT_NOEXCEPT
{
    give_up();
}

#ifndef __cpp_exceptions
/* What the library has compiled in advance throws, which brings along all that catches. */
#include <string>

template class std::basic_string<char>;
template std::string std::operator+(const char *, const std::string &);
#endif
#endif
