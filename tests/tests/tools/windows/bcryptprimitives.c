/* ProcessPrng of bcryptprimitives.dll, which the Rust library needs and Wine 8 does not have; by RtlGenRandom of advapi32.dll. */
#include <windows.h>
#include <ntsecapi.h>

__declspec(dllexport) BOOL ProcessPrng(PBYTE bytes, SIZE_T count) {
    return RtlGenRandom(bytes, (ULONG)count);
}
