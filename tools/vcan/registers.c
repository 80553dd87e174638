/* Lets user-mode Linux run on a processor with more registers than it knows, such as the tiles of AMX.
 *
 * It keeps the first 2,696 bytes of what XSAVE writes for a program, up to AVX-512 and protection keys, and hands them
 * back by PTRACE_SETREGSET. The kernel below takes nothing less than everything that the processor has: what is handed
 * back is filled up with zeros. XSTATE_BV, which is among the bytes kept, does not call them in use.
 *
 * Source: Intel 64 and IA-32 Architectures Software Developer's Manual, volume 1, chapter 13.
 */
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum { XSTATE = 0x202, MOST = 1 << 16 }; /* NT_X86_XSTATE; bytes */

/* As in the C library, in whose place it stands: what is peeked at is returned, an error is -1 and errno. */
long ptrace(enum __ptrace_request request, ...)
{
	static _Alignas(64) char whole[MOST];
	static size_t size; /* of all that the processor has */
	va_list given;
	va_start(given, request);
	pid_t process = va_arg(given, pid_t);
	void *address = va_arg(given, void *);
	struct iovec *known = va_arg(given, void *);
	va_end(given);

	if (request == PTRACE_PEEKTEXT || request == PTRACE_PEEKDATA || request == PTRACE_PEEKUSER) {
		long word;
		errno = 0;
		return syscall(SYS_ptrace, request, process, address, &word) < 0 ? -1 : word;
	}
	struct iovec all = {whole, MOST};
	if (request == PTRACE_SETREGSET && (long)address == XSTATE) {
		if (size == 0) {
			if (syscall(SYS_ptrace, PTRACE_GETREGSET, process, address, &all) < 0)
				return -1;
			size = all.iov_len;
			memset(whole, 0, MOST);
		}
		if (known->iov_len < size) {
			memcpy(whole, known->iov_base, known->iov_len);
			all.iov_len = size;
			known = &all;
		}
	}
	return syscall(SYS_ptrace, request, process, address, known);
}
