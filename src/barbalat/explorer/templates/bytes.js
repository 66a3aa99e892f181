// Decodes the numbers and modules that the page contains in Base64.

export function bytesOf(text) {
  const letters = atob(text);
  const found = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) found[i] = letters.charCodeAt(i);
  return found;
}

export function doublesOf(text) {
  return new Float64Array(bytesOf(text).buffer);
}
