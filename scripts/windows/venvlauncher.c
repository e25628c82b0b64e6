/* python.exe of a virtual environment, as CPython's venvlauncher: starts the Python that pyvenv.cfg names, in a job that ends
   with this process, and gives its exit code. The embeddable package of python.org does not contain it. */
#include <stdio.h>
#include <stdlib.h>
#include <wchar.h>
#include <windows.h>

#define LENGTH 32768

static int fail(const wchar_t *what)
{
    fwprintf(stderr, L"venvlauncher: %ls (Windows error %lu)\n", what, GetLastError());
    return 101;
}

static BOOL WINAPI stay(DWORD event)
{
    (void)event; /* The Python that was started gets it too and decides. */
    return TRUE;
}

/* The value of `home` in the UTF-8 file, into `home`. */
static int read_home(const wchar_t *file, wchar_t *home)
{
    char line[4 * MAX_PATH];
    FILE *stream = _wfopen(file, L"rb");
    int found = 0;
    while (stream && !found && fgets(line, sizeof line, stream)) {
        char *value = strchr(line, '=');
        if (!value || strncmp(line, "home", 4) || (line[4] != ' ' && line[4] != '='))
            continue;
        for (value++; *value == ' '; value++) {}
        value[strcspn(value, "\r\n")] = 0;
        found = MultiByteToWideChar(CP_UTF8, 0, value, -1, home, LENGTH);
    }
    if (stream)
        fclose(stream);
    return found;
}

/* The command line behind the name of the program. */
static const wchar_t *arguments_of(const wchar_t *line)
{
    wchar_t end = *line == L'"' ? *line++ : L' ';
    while (*line && *line != end)
        line++;
    return *line == L'"' ? line + 1 : line;
}

int wmain(void)
{
    static wchar_t self[LENGTH], file[LENGTH], program[LENGTH], command[2 * LENGTH];
    if (!GetModuleFileNameW(NULL, self, LENGTH))
        return fail(L"no name of this program");
    const wchar_t *name = wcsrchr(self, L'\\') + 1;
    swprintf(file, LENGTH, L"%.*ls..\\pyvenv.cfg", (int)(name - self), self);
    if (!read_home(file, program))
        return fail(L"pyvenv.cfg names no home");
    wcscat(program, L"\\");
    wcscat(program, name);
    SetEnvironmentVariableW(L"__PYVENV_LAUNCHER__", self);

    HANDLE job = CreateJobObjectW(NULL, NULL);
    JOBOBJECT_EXTENDED_LIMIT_INFORMATION limits = {0};
    limits.BasicLimitInformation.LimitFlags = JOB_OBJECT_LIMIT_KILL_ON_JOB_CLOSE | JOB_OBJECT_LIMIT_SILENT_BREAKAWAY_OK;
    SetInformationJobObject(job, JobObjectExtendedLimitInformation, &limits, sizeof limits);
    STARTUPINFOW start = {0};
    PROCESS_INFORMATION process;
    GetStartupInfoW(&start);
    SetConsoleCtrlHandler(stay, TRUE);
    /* Its first word is the Python that is started: that is where it takes sys._base_executable from. */
    swprintf(command, 2 * LENGTH, L"\"%ls\"%ls", program, arguments_of(GetCommandLineW()));
    if (!CreateProcessW(program, command, NULL, NULL, TRUE, 0, NULL, NULL, &start, &process))
        return fail(program);
    AssignProcessToJobObject(job, process.hProcess);
    WaitForSingleObject(process.hProcess, INFINITE);
    DWORD code = 1;
    GetExitCodeProcess(process.hProcess, &code);
    return (int)code;
}
