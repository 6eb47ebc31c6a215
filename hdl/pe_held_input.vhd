-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;

-- Purpose:  Holds an input of an entity for as long as a step computes with it.
-- Generics: A word is taken in one of EVERY steps, the first one after configuration or restart among them.
-- Timing:   The word of the clock with take_i = 1 is there from the next one on.

entity pe_held_input is
  generic (
    BITS  : positive; -- word
    EVERY : positive  -- steps from one word to the next
  );
  port (
    clk_i   : in    std_ulogic;                           -- clock
    renew_i : in    std_ulogic;                           -- steps are counted anew
    take_i  : in    std_ulogic;                           -- a step begins
    word_i  : in    std_ulogic_vector(BITS - 1 downto 0); -- word of the host
    word_o  : out   std_ulogic_vector(BITS - 1 downto 0)  -- word of the entity
  );
end entity pe_held_input;

architecture rtl of pe_held_input is

  signal word  : std_ulogic_vector(BITS - 1 downto 0) := (others => '0');
  signal count : natural range 0 to EVERY - 1         := 0;

begin

  p_word : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (take_i = '1') then
        count <= 0;

        if (count /= EVERY - 1) then
          count <= count + 1;
        end if;

        if (count = 0) then
          word <= word_i;
        end if;
      end if;

      if (renew_i = '1') then
        count <= 0;
      end if;
    end if;

  end process p_word;

  word_o <= word;

end architecture rtl;
