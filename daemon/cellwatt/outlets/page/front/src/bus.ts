/** Who wants to know of what. */

export class Bus<Topics extends object> {
  private readonly takers = new Map<keyof Topics, Set<(told: never) => void>>();

  /** Call `take` with whatever is told of a topic; the answer ends that. */
  on<T extends keyof Topics>(topic: T, take: (told: Topics[T]) => void): () => void {
    const takers = this.takers.get(topic) ?? new Set();
    this.takers.set(topic, takers.add(take as (told: never) => void));
    return () => void takers.delete(take as (told: never) => void);
  }

  tell<T extends keyof Topics>(topic: T, told: Topics[T]): void {
    for (const take of [...(this.takers.get(topic) ?? [])]) (take as (told: Topics[T]) => void)(told);
  }
}
