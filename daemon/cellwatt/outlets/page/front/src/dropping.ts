/** Files and folders that are dropped, or chosen, by their paths. */

export type Files = ReadonlyMap<string, File>;

/** All files of a drop, folders with what is in them. */
export async function filesOf(dropped: DataTransfer): Promise<Files> {
  const items = [...dropped.items].map((item) => item.webkitGetAsEntry() ?? item.getAsFile()); // only now are they there
  const found = new Map<string, File>();
  for (const item of items) {
    if (item instanceof File) found.set(item.name, item);
    else if (item) await collect(item, found);
  }
  return found;
}

/** Files that were chosen in a dialog. */
export function filesIn(list: FileList | null): Files {
  return new Map([...(list ?? [])].map((file) => [file.webkitRelativePath || file.name, file]));
}

/** Call `onfiles` with what is dropped anywhere on the page, while it `may` be; the page shows that it takes them. */
export function takeDrops(may: () => boolean, onfiles: (files: Files) => void): void {
  const over = (event: DragEvent): void => {
    if (!may() || !event.dataTransfer?.types.includes('Files')) return;
    event.preventDefault();
    document.body.classList.add('takes');
  };
  const leave = (): void => document.body.classList.remove('takes');
  document.addEventListener('dragover', over);
  document.addEventListener('dragleave', (event) => event.relatedTarget === null && leave());
  document.addEventListener('drop', (event) => {
    leave();
    if (!may() || !event.dataTransfer?.types.includes('Files')) return;
    event.preventDefault();
    void filesOf(event.dataTransfer).then(onfiles);
  });
}

async function collect(entry: FileSystemEntry, found: Map<string, File>): Promise<void> {
  const path = entry.fullPath.replace(/^\//, '');
  if (entry.isFile) {
    found.set(path, await new Promise<File>((done, fail) => (entry as FileSystemFileEntry).file(done, fail)));
    return;
  }
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  for (;;) {
    const part = await new Promise<FileSystemEntry[]>((done, fail) => reader.readEntries(done, fail)); // a hundred at a time
    if (!part.length) return;
    for (const one of part) await collect(one, found);
  }
}
